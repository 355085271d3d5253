#ifndef RIGIDHI_GRID_KERNELS_H_
#define RIGIDHI_GRID_KERNELS_H_

#include "mobility/models/forcecoupling/GridModes.h"
#include "mobility/models/forcecoupling/GridWork.h"

namespace RigidHIPlugin {

/**
 * The steps of a product on a grid, in their order, for one instruction set. A step processes a
 * slab of planes normal to x, or the columns along x with one y.
 */
template <typename T>
struct GridKernels {
    /**
     * Spread forces to the nodes of a slab. Each row of nodes is transformed to modes along z as
     * soon as no more particles reach it.
     *
     * @param dipoles  whether particles have dipoles, nine numbers each (GridChannel)
     */
    void (*spread)(const GridWork<T>& work, const GridStencils& stencils, int slab, bool dipoles,
                   const double* forces, const GridSlab<T>& nodes, GridScratch<T>& scratch);
    /** Transform a slab along y to the modes of a channel. */
    void (*transform)(const GridWork<T>& work, T* const* modes, int slab, const GridSlab<T>& nodes,
                      GridScratch<T>& scratch);
    /** Transform along x, let the fluid respond to the forces of all channels, and transform back.
     */
    void (*solve)(const GridWork<T>& work, const ChannelWork<T>* channels, int count, int y,
                  double viscosity, GridScratch<T>& scratch);
    /** Likewise for the rows y and -y of a fluid between planes. */
    void (*solveBetween)(const GridWork<T>& work, const ChannelWork<T>& channel, int y,
                         double viscosity, GridScratch<T>& scratch);
    /** Likewise for the rows y and -y of channels beside walls. */
    void (*solveBeside)(const GridWork<T>& work, const ChannelWork<T>* channels, int count, int y,
                        double viscosity, GridScratch<T>& scratch);
    /** Transform the modes of a channel back along y to a slab. */
    void (*transformBack)(const GridWork<T>& work, T* const* modes, int slab,
                          const GridSlab<T>& nodes, GridScratch<T>& scratch);
    /**
     * Average over the nodes of a slab. Each row of modes along z is transformed back to nodes as
     * soon as a particle needs it.
     *
     * @param gradients  whether to average gradients instead of velocities
     * @param averages  numbersOfPart numbers for each slice
     */
    void (*average)(const GridWork<T>& work, const GridStencils& stencils, int slab, bool gradients,
                    const GridSlab<T>& nodes, double* averages, GridScratch<T>& scratch);

    /** The steps for the best instruction set of this machine. */
    static const GridKernels& best();
};

/**
 * The steps of random fields, in addition to GridKernels::transformBack. They are in double
 * precision.
 */
struct FieldKernels {
    /** Draw modes with the root of the fluid's response, and transform them back along x. */
    void (*draw)(const GridWork<double>& work, const ChannelWork<double>* channels, int count,
                 int y, double viscosity, const ModeNoise& noise, GridScratch<double>& scratch);
    /** Likewise for the rows y and -y of a fluid between planes. */
    void (*drawBetween)(const GridWork<double>& work, const ChannelWork<double>& channel, int y,
                        double viscosity, const ModeNoise& noise, GridScratch<double>& scratch);
    /** Likewise for the rows y and -y of channels beside walls. */
    void (*drawBeside)(const GridWork<double>& work, const ChannelWork<double>* channels, int count,
                       int y, double viscosity, const ModeNoise& noise,
                       GridScratch<double>& scratch);
    /** Transform all rows of a slab back along z. */
    void (*fill)(const GridWork<double>& work, const GridSlab<double>& nodes,
                 GridScratch<double>& scratch);
    /** Average velocities, or gradients, over nodes that are all filled. */
    void (*average)(const GridWork<double>& work, const GridStencils& stencils, int slab,
                    const GridSlab<double>& nodes, bool gradients, double* averages,
                    GridScratch<double>& scratch);
    /**
     * CounterModeNoise::fill().
     *
     * @param ofPlane  whether modes with opposite nx and ny have conjugate numbers for any nz
     */
    void (*fillModes)(const NoiseStream& noise, uint32_t purpose, const int* nx, int count, int ny,
                      int nz, bool ofPlane, std::complex<double>* numbers);

    static const FieldKernels& best();
};

}  // namespace RigidHIPlugin

#endif

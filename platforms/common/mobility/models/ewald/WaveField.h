#ifndef RIGIDHI_WAVE_FIELD_H_
#define RIGIDHI_WAVE_FIELD_H_

#include <memory>
#include <vector>

#include "mobility/models/ewald/SplitBox.h"
#include "mobility/models/forcecoupling/GridFluid.h"

namespace RigidHIPlugin {

/**
 * The part of the mobility that is a sum over waves, on a grid. Forces on particles of each radius
 * have one channel, and torques another one. With stresslets, the latter is a channel for dipoles,
 * Q = S + T x/2, which contain both.
 *
 * Equation:  That of RotnePragerYamakawaGrid.h. The factor of a mode is s(k) exp(w^2 k^2/2)
 *            H(k)^(1/2)/k, with t(k) instead of s(k) for torques and dipoles, and k' instead of k
 *            in the first exponential (GridSkew). w is the width of the points' Gaussian.
 */
class WaveField {
public:
    WaveField(const HydrodynamicParticles& particles, const std::vector<EwaldKind>& kinds);
    /** Use this box from now on. The box must outlive the WaveField. */
    void setBox(const SplitBox& box);
    /**
     * @param width  of the Gaussian that points spread, nm
     * @param resolution  of the points; it must outlive the WaveField
     * @param factors  of channels: for each kind of particles, that of forces, followed by that of
     *     torques if the kind has any; they must outlive the WaveField
     */
    void setGrid(const GridShape& shape, double width, const GridResolution& resolution,
                 const std::vector<std::unique_ptr<const GridFactors>>& factors);
    void moveTo(const std::vector<OpenMM::Vec3>& positions, bool keepAnchors);
    /** Compute velocities += M forces for one column. */
    void addProduct(GridFluid& fluid, double viscosity, bool inSingle, const double* forces,
                    double* velocities);
    /** Draw the random field whose averages have the covariance of this M. */
    void draw(GridFluid& fluid, double viscosity, const NoiseStream& noise, uint32_t purpose,
              std::vector<GridField>& fields) const;
    void draw(GridFluid& fluid, double viscosity, const ModeNoise& noise,
              std::vector<GridField>& fields) const;
    /** Add the averages of the field to the velocities. */
    void addAverages(GridFluid& fluid, const std::vector<GridField>& fields, double* velocities);
    const std::vector<GridChannel>& getChannels() const { return channels; }

private:
    /** Points that share stencils: the particles of one radius, or only those with torque. */
    struct Points {
        std::vector<int> particles;
        double radius = 0;
        HydrodynamicParticles asPoints;
        std::unique_ptr<GridStencils> stencils;
    };
    /** One channel. */
    enum Moment { Forces, Torques, Dipoles };
    struct Part {
        int points;
        Moment moment;
    };
    void gather(const double* forces);
    void scatterAdd(const double* ofChannels, double* velocities) const;

    const HydrodynamicParticles& particles;
    std::vector<Points> points;
    std::vector<Part> parts;
    GridShape shape;
    std::vector<GridChannel> channels;
    std::vector<OpenMM::Vec3> positionsOfPoints;
    Eigen::VectorXd gathered, results;
    Eigen::MatrixXd gradients;
};

}  // namespace RigidHIPlugin

#endif

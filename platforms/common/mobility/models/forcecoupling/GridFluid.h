#ifndef RIGIDHI_GRID_FLUID_H_
#define RIGIDHI_GRID_FLUID_H_

#include <Eigen/Core>
#include <atomic>
#include <memory>
#include <mutex>

#include "linearalgebra/AlignedArray.h"
#include "mobility/GridSeconds.h"
#include "mobility/models/forcecoupling/GridChannels.h"
#include "mobility/models/forcecoupling/GridModes.h"
#include "mobility/models/forcecoupling/GridStencils.h"

namespace RigidHIPlugin {

/**
 * Velocities of a fluid on the nodes of a grid, times the square root of a node's volume, for the
 * weights of GridStencils.
 */
struct GridField {
    GridShape shape;
    int rowLength = 0;  // distance from one row along z to the next; at least the number of nodes
                        // in a row
    AlignedArray values[3];  // components; z runs fastest
};

/**
 * A Stokes fluid on a periodic grid that couples the particles of stencils: spreading, Fourier
 * transforms, averaging.
 *
 * Products and random fields exclude the same two kinds of modes. Without the mode k = 0, fluid and
 * particles together do not drift, and a uniform background balances net forces. The other kind are
 * the Nyquist planes of even sizes. So the covariance of averaged fields is the matrix of
 * multiply(), to rounding.
 *
 * On a mirrored grid (GridShape) forces act together with their reflections, (Fx, -Fy, Fz) at (x,
 * -y, z) and (-Tx, Ty, -Tz). Particles average the flow between the walls and its reflection beyond
 * the walls. The centres of particles must be between the walls.
 *
 * On a grid with planes (GridShape) the fluid and its random field are those between these planes.
 * Flows along the planes include the mode k = 0, and the planes balance net forces instead of a
 * background.
 *
 * Vectors have the rows of HydrodynamicParticles. A GridFluid keeps plans and work space for the
 * last size. Models of several groups share one GridFluid in turn, and several threads may call its
 * members at once.
 */
class GridFluid {
public:
    virtual ~GridFluid() {}
    /**
     * Compute velocities = M forces, column by column.
     *
     * @param viscosity  dalton/(nm ps)
     */
    void multiply(const GridStencils& stencils, double viscosity, const Eigen::MatrixXd& forces,
                  Eigen::MatrixXd& velocities);
    /** Whether multiplyInSingle() takes less time. */
    virtual bool hasSinglePrecision() const { return false; }
    /**
     * Likewise with an error of at most Accuracy::errorOfSinglePrecision, if that takes less time.
     */
    void multiplyInSingle(const GridStencils& stencils, double viscosity,
                          const Eigen::MatrixXd& forces, Eigen::MatrixXd& velocities);
    /**
     * Draw the random field whose averages have the covariance M: u(k) = (eta V)^(-1/2) (1 - k
     * k/k^2) zeta/|k|. It has the same law as the field of the paper's fluctuating stress (Westwood
     * 2022, eqs. 27 to 30), but needs three numbers for each mode instead of six. Stencils of the
     * same width as these may average the field.
     */
    void draw(const GridStencils& stencils, double viscosity, const NoiseStream& noise,
              uint32_t purpose, GridField& field);
    /** Likewise with given random numbers. */
    void draw(const GridStencils& stencils, double viscosity, const ModeNoise& noise,
              GridField& field);
    /** Set the velocities to averages of the field. */
    void average(const GridField& field, const GridStencils& stencils, Eigen::VectorXd& velocities);
    /**
     * Derivatives of the velocities (without angular velocities) by the particles' positions:
     * dv_a/dx_b at (3 a + b, particle).
     */
    void averageGradients(const GridField& field, const GridStencils& stencils,
                          Eigen::MatrixXd& gradients);
    /**
     * Compute velocities = M forces for channels that share one grid, which must not be mirrored.
     * M_gh = sum over modes of phi_g phi_h (1 - k k/k^2)/(eta V), times half of a curl on each side
     * with torques, and with gradients on each side with dipoles. Vectors are one column, with one
     * channel after the other.
     *
     * Cost: six transforms and two passes over particles for each channel.
     *
     * @param inSingle  as multiplyInSingle()
     */
    void multiply(const std::vector<GridChannel>& channels, double viscosity, bool inSingle,
                  const Eigen::VectorXd& forces, Eigen::VectorXd& velocities);
    /**
     * Draw the random fields, one for each channel, whose averages have the covariance of that M.
     */
    void draw(const std::vector<GridChannel>& channels, double viscosity, const NoiseStream& noise,
              uint32_t purpose, std::vector<GridField>& fields);
    void draw(const std::vector<GridChannel>& channels, double viscosity, const ModeNoise& noise,
              std::vector<GridField>& fields);
    /**
     * Call task(first, end) for ranges that cover 0 ... count - 1, on as many threads as the fluid
     * itself uses.
     */
    virtual void forRanges(int count, const std::function<void(int, int)>& task) const {
        task(0, count);
    }
    /**
     * The time that the fluid has taken so far. Do not read it while another thread uses the fluid.
     */
    const GridSeconds& getSeconds() const { return seconds; }
    /** Bytes that the fluid already holds. */
    double memoryHeld() const { return held; }
    /**
     * Bytes for a grid with one random field and modes in single precision. They do not include
     * stencils, which belong to the MobilityAt objects.
     */
    static double memory(const GridShape& shape) {
        return 8.0 * 3 * 2.7 * shape.size[0] * shape.numRows() * shape.size[2];
    }

protected:
    virtual void multiplyColumn(const GridStencils& stencils, double viscosity,
                                const double* forces, double* velocities) = 0;
    virtual void multiplyColumnInSingle(const GridStencils& stencils, double viscosity,
                                        const double* forces, double* velocities) {
        multiplyColumn(stencils, viscosity, forces, velocities);
    }
    virtual void drawModes(const GridStencils& stencils, double viscosity, const ModeNoise& noise,
                           GridField& field) = 0;
    virtual void multiplyChannels(const std::vector<GridChannel>& channels, double viscosity,
                                  bool inSingle, const double* forces, double* velocities) = 0;
    virtual void drawChannels(const std::vector<GridChannel>& channels, double viscosity,
                              const ModeNoise& noise, std::vector<GridField>& fields) = 0;
    virtual std::unique_ptr<ModeNoise> modeNoise(const NoiseStream& noise, uint32_t purpose) const;
    virtual void averageColumn(const GridField& field, const GridStencils& stencils,
                               double* velocities) = 0;
    virtual void averageGradientColumn(const GridField& field, const GridStencils& stencils,
                                       double* gradients) = 0;
    GridSeconds seconds;
    std::atomic<double> held{0};

private:
    std::mutex inUse;
};

/**
 * A GridFluid with one thread and each transform in one piece, written to be read beside the paper.
 *
 * Reference: Yeo, Maxey, J. Comput. Phys. 229, 2401 (2010); Keaveny, J. Comput. Phys. 269, 61
 * (2014); Westwood 2022, sections 2 to 4.
 */
class PlainGridFluid : public GridFluid {
public:
    ~PlainGridFluid() override;

protected:
    void multiplyColumn(const GridStencils& stencils, double viscosity, const double* forces,
                        double* velocities) override;
    void drawModes(const GridStencils& stencils, double viscosity, const ModeNoise& noise,
                   GridField& field) override;
    void averageColumn(const GridField& field, const GridStencils& stencils,
                       double* velocities) override;
    void averageGradientColumn(const GridField& field, const GridStencils& stencils,
                               double* gradients) override;
    void multiplyChannels(const std::vector<GridChannel>& channels, double viscosity, bool inSingle,
                          const double* forces, double* velocities) override;
    void drawChannels(const std::vector<GridChannel>& channels, double viscosity,
                      const ModeNoise& noise, std::vector<GridField>& fields) override;

private:
    void prepare(const GridShape& shape);
    void forward();
    void release();
    void spread(const GridStencils& stencils, const double* forces);
    void spreadDipoles(const GridStencils& stencils, const double* dipoles);
    void addReflections();
    void respond(double viscosity);
    void respondWithoutPlanes(double viscosity, double* netForce);
    template <class Respond, class Add>
    void confine(const Respond& respond, const Add& add);
    void addResponse(int x, int y, const std::complex<double>* forces);
    std::complex<double>& mode(int c, int x, int y, int z);
    void store(size_t at, const std::complex<double>* mode);
    void backward(GridField& field);
    void drawInto(const GridShape& shape, double viscosity, const ModeNoise& noise,
                  const GridFactors* factors);

    friend class GridFlow;
    GridShape planned;
    void *forwardPlan = nullptr, *backwardPlan = nullptr;
    GridField work;
    AlignedArray modes[3];                      // pairs of real and imaginary part
    std::vector<AlignedArray> modesOfChannels;  // likewise, three for each channel
};

/**
 * The flow on a grid at points between its nodes: the sum of its modes there, exactly. Planes add
 * the flow of their forces with all modes along z. Cost: one operation for each mode and point.
 */
class GridFlow {
public:
    /** Set the flow of forces. */
    void spread(const GridStencils& stencils, double viscosity, const double* forces);
    /** Set the random field of GridFluid::draw(). */
    void draw(const GridStencils& stencils, double viscosity, const ModeNoise& noise);
    /** Likewise with these factors of modes instead of 1/|k|; null for 1/|k|. */
    void draw(const GridShape& shape, double viscosity, const ModeNoise& noise,
              const GridFactors* factors);
    /** Add `factor` times the flow to the velocities. */
    void addAt(const std::vector<OpenMM::Vec3>& points, double factor,
               Eigen::Matrix3Xd& velocities);

private:
    struct ForcesOfPlanes {
        int x, y;  // of the wave vector
        std::complex<double> forces[9];
    };
    PlainGridFluid fluid;
    std::vector<ForcesOfPlanes> ofPlanes;  // their flow is not among the modes
    Eigen::VectorXd ofMean[2];
};

/** The component of the random field of GridFluid::draw() along sin(k x_b + phase) e_a of a wave.
 */
double amplitudeOfMode(const GridShape& shape, double viscosity, const ModeNoise& noise,
                       const DrivenFlow& wave);

}  // namespace RigidHIPlugin

#endif

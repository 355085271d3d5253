#ifndef RIGIDHI_WAVE_FIELD_H_
#define RIGIDHI_WAVE_FIELD_H_

#include <memory>
#include <vector>

#include "mobility/models/ewald/SplitBox.h"
#include "mobility/models/forcecoupling/GridFluid.h"

namespace RigidHIPlugin {

/**
 * The part of the mobility that is summed over waves, on a grid: a channel for the forces on
 * particles of each radius, and one for their torques.
 *
 * Equation:  RotnePragerYamakawaGrid.h; the factor of a mode is s(k) exp(w^2 k^2/2) H(k)^(1/2)/k,
 * t(k) instead of s(k) for torques, with the width w of the Gaussian that points spread.
 */
class WaveField {
public:
    WaveField(const HydrodynamicParticles& particles, const std::vector<EwaldKind>& kinds);
    /** Be in this box from now on, which must outlive it. */
    void setBox(const SplitBox& box);
    void moveTo(const std::vector<OpenMM::Vec3>& positions, bool keepAnchors);
    /** velocities += M forces, of one column. */
    void addProduct(GridFluid& fluid, double viscosity, bool roughly, const double* forces,
                    double* velocities);
    /** The random field whose averages have the covariance of this M. */
    void draw(GridFluid& fluid, double viscosity, const NoiseStream& noise, uint32_t purpose,
              std::vector<GridField>& fields) const;
    void draw(GridFluid& fluid, double viscosity, const ModeNoise& noise,
              std::vector<GridField>& fields) const;
    /** velocities += averages of the field. */
    void addAverages(GridFluid& fluid, const std::vector<GridField>& fields, double* velocities);
    const std::vector<GridChannel>& getChannels() const { return channels; }

private:
    /** Points that share stencils: particles of one radius, or those of them with torque. */
    struct Points {
        std::vector<int> particles;
        HydrodynamicParticles asPoints;
        std::unique_ptr<GridStencils> stencils;
    };
    /** One channel. */
    struct Part {
        int points;
        bool ofTorques;
    };
    void scatterAdd(const double* ofChannels, double* velocities) const;

    const HydrodynamicParticles& particles;
    std::vector<Points> points;
    std::vector<Part> parts;
    GridShape shape;
    std::vector<GridChannel> channels;
    std::vector<OpenMM::Vec3> positionsOfPoints;
    Eigen::VectorXd gathered, results;
};

}  // namespace RigidHIPlugin

#endif

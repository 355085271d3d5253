#ifndef RIGIDHI_SPLIT_PARTS_H_
#define RIGIDHI_SPLIT_PARTS_H_

#include <memory>
#include <mutex>
#include <vector>

#include "mobility/models/ewald/NearField.h"
#include "mobility/models/ewald/SplitBox.h"
#include "mobility/models/ewald/WaveField.h"

namespace RigidHIPlugin {

/** Pairs and waves at one placement, for products and fields. Several threads may use them. */
class SplitParts {
public:
    using MatrixXd = Eigen::MatrixXd;
    SplitParts(const HydrodynamicParticles& particles, double viscosity,
               const std::vector<EwaldKind>& kinds, GridFluid& fluid);
    void setBox(const std::shared_ptr<const SplitBox>& newBox);
    /**
     * @param nearby  whether the placement is a small displacement from the last placement that was
     *     not nearby; the parts then keep the pairs and nodes of that placement
     */
    void moveTo(const std::vector<OpenMM::Vec3>& newPositions, bool nearby);
    /** Whether the parts are at this placement, with its own pairs and nodes. */
    bool isAt(const std::shared_ptr<const SplitBox>& inBox,
              const std::vector<OpenMM::Vec3>& there) const {
        return inBox == box && isOwnAnchor && there == anchor;
    }
    const std::shared_ptr<const SplitBox>& getBox() const { return box; }
    /** The positions of the last placement that was not nearby. */
    const std::vector<OpenMM::Vec3>& getAnchor() const { return anchor; }

    /** Compute velocities = M forces. */
    void multiply(const MatrixXd& forces, bool inSingle, MatrixXd& velocities);
    /** Likewise with the matrix of pairs alone. */
    void multiplyPairs(const MatrixXd& forces, MatrixXd& velocities);
    void draw(const NoiseStream& noise, uint32_t purpose, std::vector<GridField>& fields);
    /** Add the averages of a random field to the velocities. */
    void addAverages(const std::vector<GridField>& fields, MatrixXd& velocities);

    /** Calls tasks on as many threads as the fluid uses. */
    Ranges ranges() const {
        return [this](int count, const std::function<void(int, int)>& task) {
            fluid.forRanges(count, task);
        };
    }

private:
    const double viscosity;
    GridFluid& fluid;
    std::mutex inUse;
    NearField near;
    WaveField waves;
    std::vector<int> kindOfParticle;
    std::shared_ptr<const SplitBox> box;
    std::vector<OpenMM::Vec3> anchor;
    bool isOwnAnchor = false;  // whether the parts are at the anchor
};

}  // namespace RigidHIPlugin

#endif

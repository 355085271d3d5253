#ifndef RIGIDHI_COUPLED_BODIES_SUPPORT_H_
#define RIGIDHI_COUPLED_BODIES_SUPPORT_H_

#include <memory>

#include "rigid/BodyMobilities.h"

namespace RigidHITest {

/** A group of bodies with all strategies for its mobility, at the same poses. */
class TestedBodies {
public:
    using MatrixXd = Eigen::MatrixXd;
    using BodyMobility = RigidHIPlugin::BodyMobility;
    using CoupledBodies = RigidHIPlugin::CoupledBodies;

    TestedBodies(const std::vector<RigidHIPlugin::FluidElement>& elements,
                 const CoupledBodies::ModelFactory& makeModel, bool mayBeConstant = true,
                 double tolerance = 1e-6)
        : bodies(new CoupledBodies(elements, makeModel, mayBeConstant)),
          strategies(new RigidHIPlugin::BodyMobilities(*bodies, tolerance)) {}
    CoupledBodies& operator*() const { return *bodies; }
    CoupledBodies* operator->() const { return bodies.get(); }

    /** The strategy without iterations: a constant tensor, or dense matrices. */
    BodyMobility& byMatrices() {
        return strategies->get(bodies->isConstantInBodyFrame() ? BodyMobility::Constant
                                                               : BodyMobility::Dense);
    }
    BodyMobility& byProducts() { return strategies->get(BodyMobility::Krylov); }
    /** The strategy that answers questions of users. For spheres it has no matrices. */
    BodyMobility& answering() {
        return bodies->multipliesWithoutIterations() && !bodies->isConstantInBodyFrame()
                   ? byProducts()
                   : byMatrices();
    }

    void setPoses(const std::vector<RigidHIPlugin::Pose>& poses) {
        byMatrices().setPoses(poses);
        if (&answering() != &byMatrices()) answering().setPoses(poses);
    }
    const MatrixXd& mobility() { return byMatrices().mobility(); }
    const MatrixXd& friction() { return byMatrices().friction(); }
    void multiply(const MatrixXd& wrenches, MatrixXd& twists) {
        answering().multiply(wrenches, twists);
    }

private:
    std::shared_ptr<CoupledBodies> bodies;
    std::shared_ptr<RigidHIPlugin::BodyMobilities> strategies;
};

}  // namespace RigidHITest

#endif

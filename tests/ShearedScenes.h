#ifndef RIGIDHI_SHEARED_SCENES_H_
#define RIGIDHI_SHEARED_SCENES_H_

// Spheres of two radii in cubic and tilted boxes, with values from an independent program
// (tests/data/sheared).

#include "ReferenceScenes.h"
#include "TestSupport.h"
#include "mobility/MobilityAt.h"
#include "mobility/models/periodic/Lattice.h"

namespace RigidHITest {

struct ShearedScene {
    const JsonValue& data;
    RigidHIPlugin::HydrodynamicParticles particles;
    RigidHIPlugin::Placement placement;
    double viscosity;

    explicit ShearedScene(const JsonValue& data) : data(data), viscosity(data["eta"].number) {
        const auto asVec3 = [](const Eigen::Vector3d& v) { return OpenMM::Vec3(v[0], v[1], v[2]); };
        for (int k = 0; k < 3; k++) placement.box[k] = asVec3(data["box"][k].vector3());
        const std::vector<double> radii = data["radii"].numbers();
        for (size_t i = 0; i < radii.size(); i++) {
            particles.add(radii[i], true, i, i);
            placement.positions.push_back(asVec3(data["positions"][i].vector3()));
        }
    }
    /**
     * Expect the twists, stresslets and viscosity of the file from the mobility at the placement.
     */
    void check(RigidHIPlugin::MobilityAt& at, double tolerance) const {
        const auto expectNear = [&](const Eigen::VectorXd& value, const char* name) {
            const Eigen::VectorXd expected = data[name].column();
            EXPECT_LT((value - expected).norm(), tolerance * expected.norm()) << name;
        };
        const Eigen::VectorXd wrench = data["wrench"].column();
        Eigen::MatrixXd twists, slips;
        at.multiply(wrench, twists);
        expectNear(twists.col(0), "twistOfWrench");
        expectNear(at.sources(wrench, nullptr).stresslets, "stressletOfWrench");
        RigidHIPlugin::DrivenFlow flow;
        for (int row = 0; row < 3; row++)
            flow.gradient.row(row) = data["gradient"][row].vector3().transpose();
        slips.setZero(6 * particles.size(), 1);
        at.addStressletsOf(flow, slips);
        expectNear(slips.col(0), "twistInShearMinusBackground");
        const Eigen::VectorXd stresslets =
            at.sources(Eigen::MatrixXd::Zero(slips.rows(), 1), &flow).stresslets;
        expectNear(stresslets, "stressletInShear");
        double xy = 0;
        for (int i = 0; i < particles.size(); i++) xy += stresslets[5 * i + 2] / std::sqrt(2);
        EXPECT_NEAR(1 - xy / RigidHIPlugin::Lattice(placement.box).getVolume(),
                    data["relativeViscosity"].number, tolerance);
    }
};

}  // namespace RigidHITest

#endif

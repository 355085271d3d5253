#ifndef RIGIDHI_WATER_BOX_SUPPORT_H_
#define RIGIDHI_WATER_BOX_SUPPORT_H_

// A box of rigid waters.

#include <openmm/NonbondedForce.h>
#include <openmm/VirtualSite.h>

#include <memory>
#include <random>
#include <vector>

#include "TestSupport.h"

namespace RigidHITest {

/** Four-site waters with constraints, charges and a virtual site, on a grid. */
struct WaterBox {
    OpenMM::System system;
    CustomRigidHIIntegrator integrator;
    std::vector<Vec3> positions;
    std::unique_ptr<OpenMM::Context> context;
    int side;
    explicit WaterBox(int side, double h = 0.001, bool periodic = false)
        : integrator(300, h), side(side) {
        const Shape water = waterShape();
        auto* nonbonded = new OpenMM::NonbondedForce();
        std::mt19937 generator(2);
        for (int i = 0; i < side * side * side; i++) {
            const int p = system.addParticle(water.masses[0]);
            system.addParticle(water.masses[1]);
            system.addParticle(water.masses[2]);
            system.addParticle(0);
            system.addConstraint(p, p + 1, 0.09572);
            system.addConstraint(p, p + 2, 0.09572);
            system.addConstraint(p + 1, p + 2, norm(water.sites[1] - water.sites[2]));
            system.setVirtualSite(p + 3,
                                  new OpenMM::ThreeParticleAverageSite(p, p + 1, p + 2, 0.786646558,
                                                                       0.106676721, 0.106676721));
            nonbonded->addParticle(0, 0.315365, 0.6485);
            nonbonded->addParticle(0.52, 1, 0);
            nonbonded->addParticle(0.52, 1, 0);
            nonbonded->addParticle(-1.04, 1, 0);
            for (int a = 0; a < 4; a++)
                for (int b = 0; b < a; b++) nonbonded->addException(p + a, p + b, 0, 1, 0);
            const QuaternionArray q = randomQuaternion(generator);
            const Vec3 origin(0.31 * (i % side), 0.31 * (i / side % side),
                              0.31 * (i / side / side));
            for (const Vec3& s : water.sites) positions.push_back(origin + rotate(q, s));
            positions.push_back(positions[p] * 0.786646558 +
                                (positions[p + 1] + positions[p + 2]) * 0.106676721);
            integrator.addRigidBody({p, p + 1, p + 2, p + 3});
        }
        if (periodic) {
            const double length = 0.31 * side;
            system.setDefaultPeriodicBoxVectors(Vec3(length, 0, 0), Vec3(0, length, 0),
                                                Vec3(0, 0, length));
            nonbonded->setNonbondedMethod(OpenMM::NonbondedForce::CutoffPeriodic);
            nonbonded->setCutoffDistance(0.4 * length);
        }
        system.addForce(nonbonded);
        integrator.setRandomNumberSeed(3);
    }
    void start() {
        context = std::make_unique<OpenMM::Context>(system, integrator, testPlatform(),
                                                    threads(testPlatformName(), 2));
        context->setPositions(positions);
    }
};

}  // namespace RigidHITest

#endif

#ifndef RIGIDHI_DEVICE_SUPPORT_H_
#define RIGIDHI_DEVICE_SUPPORT_H_

// Scenes of bodies that move on a device.

#include <openmm/NonbondedForce.h>

#include <algorithm>
#include <map>
#include <memory>
#include <random>
#include <string>
#include <vector>

#include "TestSupport.h"

namespace RigidHITest {

inline const char* const bodiesKey = "bodies on the device";

inline bool areOnTheDevice(const CustomRigidHIIntegrator& integrator) {
    return integrator.getEffects().at(bodiesKey).substr(0, 3) == "on:";
}

/** Bodies of every kind with shapes that are given, and free particles, in a triclinic box. */
struct Bodies {
    OpenMM::System system;
    CustomRigidHIIntegrator integrator;
    std::vector<Vec3> positions;
    std::unique_ptr<OpenMM::Context> context;
    int numBodies = 0, firstFree = 0;

    /**
     * @param epsilon  of a Lennard-Jones force between all particles; its cutoff makes OpenMM sort
     *     particles
     * @param count    of bodies; more than 27 overlap
     */
    explicit Bodies(double epsilon = 0, double h = 0.002, double length = 2.4, int count = 24)
        : integrator(300, h) {
        auto* nonbonded = new OpenMM::NonbondedForce();
        nonbonded->setNonbondedMethod(OpenMM::NonbondedForce::CutoffPeriodic);
        nonbonded->setCutoffDistance(0.9);
        const std::vector<Shape> shapes = {
            {"water", {16, 1, 1}, {Vec3(0, -0.006, 0), Vec3(0.08, 0.05, 0), Vec3(-0.08, 0.05, 0)}},
            {"rod", {12, 16}, {Vec3(0.06, 0, 0), Vec3(-0.05, 0, 0)}},
            {"point", {40}, {Vec3()}}};
        for (int i = 0; i < count; i++) {
            const Shape& shape = shapes[i % 3];
            std::vector<int> particles;
            const Vec3 origin(0.3 + length / 3 * (i % 3), 0.2 + length / 3 * (i / 3 % 3),
                              0.1 + length / 3 * (i / 9));
            for (size_t s = 0; s < shape.sites.size(); s++) {
                particles.push_back(system.addParticle(shape.masses[s]));
                positions.push_back(origin + shape.sites[s]);
                nonbonded->addParticle(0, epsilon == 0 ? 0 : 0.25, epsilon);
                for (size_t t = 0; t < s; t++) {
                    nonbonded->addException(particles[s], particles[t], 0, 1, 0);
                    system.addConstraint(particles[s], particles[t],
                                         norm(shape.sites[s] - shape.sites[t]));
                }
            }
            const Vec3 moments = i % 3 == 0   ? Vec3(0.006, 0.013, 0.019)
                                 : i % 3 == 1 ? Vec3(0, 0.08, 0.08)
                                              : Vec3();
            integrator.addRigidBody(particles,
                                    i % 3 == 0   ? 18
                                    : i % 3 == 1 ? 28
                                                 : 40,
                                    moments, shape.sites);
            numBodies++;
        }
        firstFree = system.getNumParticles();
        for (int i = 0; i < 5; i++) {
            system.addParticle(23);
            nonbonded->addParticle(0, epsilon == 0 ? 0 : 0.25, epsilon);
            positions.push_back(Vec3(0.7 + 0.35 * i, 0.55, 0.5));
        }
        system.addForce(nonbonded);
        system.setDefaultPeriodicBoxVectors(Vec3(length, 0, 0), Vec3(0.3, length, 0),
                                            Vec3(-0.4, 0.5, length));
        integrator.setFriction(5);
        integrator.setRotationalFriction(20);
        integrator.setRandomNumberSeed(11);
    }
    void start(const std::string& platformName,
               const std::map<std::string, std::string>& properties = {}) {
        context = std::make_unique<OpenMM::Context>(system, integrator, platform(platformName),
                                                    properties);
        context->setPositions(positions);
        // The Context rounds positions, and the setters of bodies do not.
        std::mt19937 generator(5);
        std::normal_distribution<double> normal;
        std::vector<Vec3> R, v, omega;
        std::vector<QuaternionArray> q;
        int p = 0;
        for (int b = 0; b < numBodies; b++) {
            // Water's first site is not at the origin.
            R.push_back(positions[p] - (b % 3 == 0   ? Vec3(0, -0.006, 0)
                                        : b % 3 == 1 ? Vec3(0.06, 0, 0)
                                                     : Vec3()));
            p += b % 3 == 0 ? 3 : b % 3 == 1 ? 2 : 1;
            q.push_back(randomQuaternion(generator));
            v.push_back(Vec3(normal(generator), normal(generator), normal(generator)) * 0.4);
            omega.push_back(Vec3(normal(generator), normal(generator), normal(generator)) * 10);
        }
        integrator.setBodyPositions(R);
        integrator.setBodyOrientations(q);
        if (integrator.getScheme() == CustomRigidHIIntegrator::GradientThermostat) return;
        integrator.setBodyVelocities(v);
        integrator.setBodyAngularVelocities(omega);
    }
};

/** The largest difference of positions or orientations of bodies. */
inline double poseDifference(const CustomRigidHIIntegrator& a, const CustomRigidHIIntegrator& b) {
    double largest = 0;
    const auto Ra = a.getBodyPositions(), Rb = b.getBodyPositions();
    const auto qa = a.getBodyOrientations(), qb = b.getBodyOrientations();
    for (size_t i = 0; i < Ra.size(); i++) {
        largest = std::max(largest, norm(Ra[i] - Rb[i]));
        for (int k = 0; k < 4; k++) largest = std::max(largest, std::abs(qa[i][k] - qb[i][k]));
    }
    return largest;
}

}  // namespace RigidHITest

#endif

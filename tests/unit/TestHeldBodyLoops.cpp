// Held bodies and free particles in schemes with momenta: their slots in BodySet, the effect of the
// loops on them and on the others (body by body and in packs), and the momenta of a group in a
// fluid beside them.

#include "CoupledBodiesSupport.h"
#include "HydrodynamicSupport.h"
#include "fluid/MomentumScaling.h"
#include "host/FreeParticles.h"
#include "host/MidStep.h"
#include "host/ScalarLoops.h"
#include "host/SimdBodyLoops.h"
#include "mobility/models/rotneprager/RotnePragerYamakawa.h"
#include "schemes/Thermostats-inl.h"

using namespace OpenMM;
using namespace RigidHIPlugin;
using namespace RigidHITest;
using namespace std;

namespace {

using Scheme = CustomRigidHIIntegrator::Scheme;
const Scheme thermostatSchemes[] = {
    CustomRigidHIIntegrator::LangevinA, CustomRigidHIIntegrator::LangevinB,
    CustomRigidHIIntegrator::LangevinC, CustomRigidHIIntegrator::GradientThermostat};

/** Bodies of every kind of rotor and particle arrays, with states, forces and noise. */
struct Loops {
    static const int numBodies = 33;
    vector<bool> held;
    vector<BodyGeometry> geometries;
    vector<vector<int>> particles;
    BodySet set;
    StepSettings settings;
    vector<double> positions, velocities, forces, lastPositions, lastVelocities;

    /** @param everyThird  whether every third body is held, so that each kind of rotor is */
    explicit Loops(bool everyThird, Scheme scheme = CustomRigidHIIntegrator::LangevinC,
                   bool massesAreSites = true) {
        const Vec3 moments[] = {Vec3(0.3, 0.7, 0.5), Vec3(0.4, 0.4, 0), Vec3()};
        vector<vector<double>> siteMasses(numBodies);
        vector<vector<bool>> carriesForce(numBodies);
        int next = 0;
        for (int b = 0; b < numBodies; b++) {
            BodyGeometry geometry;
            geometry.mass = 1 + 0.1 * b;
            geometry.moments = moments[b / 3 % 3];
            const int sites = 1 + b % 4;
            particles.emplace_back();
            for (int i = 0; i < sites; i++) {
                geometry.sites.emplace_back(0.1 * i, -0.2 * i, 0.05 * b);
                particles.back().push_back(next++);
            }
            geometries.push_back(geometry);
            if (massesAreSites) siteMasses[b].assign(sites, geometry.mass / sites);
            carriesForce[b].assign(sites, true);
            held.push_back(everyThird && b % 3 == 1);
        }
        set = BodySet(geometries, particles, siteMasses, carriesForce, held);
        settings.scheme = scheme;
        settings.h = 0.07;
        settings.kT = 1.3;
        settings.noise.seed = 5;
        for (int b = 0; b < numBodies; b++) {
            BodyState state;
            state.R = Vec3(b, -0.3 * b, 0.1);
            state.p = Vec3(0.2, 0.1 * b, -0.4);
            state.l = Vec3(0.3, -0.2, 0.01 * b);
            const double angle = 0.1 * (b + 1);
            state.q = {{cos(angle), 0.6 * sin(angle), 0, 0.8 * sin(angle)}};
            set.setState(b, state);
            setThermostat(b);
        }
        for (int i = 0; i < 3 * next; i++) {
            positions.push_back(100 + i);
            velocities.push_back(200 + i);
            forces.push_back(sin(1.0 + i));
        }
        lastPositions = lastVelocities = vector<double>(3 * next, -1.0);
    }
    void setThermostat(int b) {
        HeatBath bath;
        bath.kT = settings.kT;
        bath.gamma = 2;
        bath.Gamma = 3;
        bath.upsilon = 0.4;
        bath.Upsilon = 0.2;
        set.setThermostat(b, scalar::withThermostat(settings.scheme, [&](auto named) {
                              return named.coefficients(set.inertia(b), bath, settings.h);
                          }));
    }
    LoopResult run(BodyLoop loop, bool packs) {
        const ParticleArrays arrays = {positions.data(), velocities.data(), forces.data(),
                                       lastPositions.data(), lastVelocities.data()};
        if (packs) return runSimdBodyLoop(loop, set, settings, arrays, 0, set.getNumBlocks());
        return ScalarLoops().run(loop, set, settings, arrays);
    }
    Vec3 of(const vector<double>& array, int particle) const {
        return Vec3(array[3 * particle], array[3 * particle + 1], array[3 * particle + 2]);
    }
};

array<double, 13> atRest(array<double, 13> stored) {
    fill(stored.begin() + 7, stored.end(), 0.0);
    return stored;
}

}  // namespace

TEST(HeldBodySet, KeepsPosesAndHasNoMomenta) {
    Loops loops(true), free(false);
    BodySet &set = loops.set, &others = free.set;
    EXPECT_EQ(set.getNumMovable(), 22);
    EXPECT_EQ(others.getNumMovable(), 33);
    bool heldBlocks = false;
    for (const auto& block : set.blocks) {
        EXPECT_FALSE(heldBlocks && block.rotor != RotorKind::Held);  // they come last
        heldBlocks = block.rotor == RotorKind::Held;
    }
    EXPECT_TRUE(heldBlocks);
    for (int b = 0; b < loops.numBodies; b++) {
        const int s = set.slot(b);
        ASSERT_EQ(set.isHeld(b), loops.held[b]);
        EXPECT_FALSE(others.isHeld(b));
        const array<double, 13> stored = others.getStoredState(b);
        if (!loops.held[b]) {
            EXPECT_EQ(set.getStoredState(b), stored);
            EXPECT_EQ(set.rotor(b), others.rotor(b));
            continue;
        }
        EXPECT_EQ(set.getStoredState(b), atRest(stored));
        EXPECT_EQ(set.inertia(b).mass, loops.geometries[b].mass);
        set.setStoredState(b, stored);
        EXPECT_EQ(set.getStoredState(b), atRest(stored));
        set.setAngularVelocity_lab(b, Vec3(1, 2, 3));
        EXPECT_EQ(set.getStoredState(b), atRest(stored));
        EXPECT_EQ(set.getAngularVelocity_lab(b), Vec3());
        EXPECT_EQ(set.inverseMass[s], 0);
        EXPECT_EQ(set.decay_p[s], 1);
        EXPECT_EQ(set.noise_p[s], 0);
        EXPECT_EQ(set.move_R[s], 0);
        EXPECT_FALSE(set.drawsNoise[s]);
        set.setInertiaScale(2);
        for (int k = 0; k < 3; k++) EXPECT_EQ(set.inverseMoments[k][s], 0);
        set.setInertiaScale(1);
    }
    double translational = 0;
    for (int b = 0; b < loops.numBodies; b++) {
        const Vec3 p = others.getState(b).p;
        if (!loops.held[b]) translational += p.dot(p) / 2 / others.inertia(b).mass;
    }
    EXPECT_NEAR(set.translationalKineticEnergy(), translational, 1e-13);
}

TEST(HeldBodySet, BodiesAreHeldAndLetGoWhereTheyAre) {
    Loops free(false), held(true), released(false);
    free.set.setInertiaScale(3);
    free.run(BodyLoop::GatherForces, false);
    held.set.takeStates(free.set);
    released.set.takeStates(held.set);
    for (BodySet* set : {&held.set, &released.set}) {
        EXPECT_EQ(set->getInertiaScale(), 3);
        for (int b = 0; b < free.numBodies; b++) {
            const array<double, 13> stored = free.set.getStoredState(b);
            EXPECT_EQ(set->getStoredState(b), held.held[b] ? atRest(stored) : stored) << b;
            EXPECT_EQ(set->getForce_lab(b), free.set.getForce_lab(b));
            EXPECT_EQ(set->getTorque_lab(b), free.set.getTorque_lab(b));
            for (int k = 0; k < 3; k++)
                EXPECT_EQ(set->inertia(b).moments[k], free.set.inertia(b).moments[k]);
        }
    }
    for (int b = 0; b < free.numBodies; b++)
        for (int k = 0; k < 3; k++)
            EXPECT_EQ(released.set.inverseMoments[k][released.set.slot(b)],
                      free.set.inverseMoments[k][free.set.slot(b)]);
}

TEST(HeldBodyLoops, LeaveHeldBodiesAndMoveOthersAsEver) {
    for (bool packs : {false, true})
        for (Scheme scheme : thermostatSchemes) {
            Loops loops(true, scheme), all(false, scheme), start(true, scheme);
            const bool hasMomenta = loops.settings.hasMomenta();
            for (int step = 0; step < 5; step++) {
                long long ofHeld = 0, drawn = 0, ofAll = 0;
                for (BodyLoop part : {BodyLoop::BeforeForces, BodyLoop::AfterForces}) {
                    const LoopResult result = loops.run(part, packs), of = all.run(part, packs);
                    EXPECT_TRUE(result.finite && of.finite);
                    drawn += result.randomNumbers;
                    ofAll += of.randomNumbers;
                }
                const int draws = scheme == CustomRigidHIIntegrator::LangevinC ||
                                          scheme == CustomRigidHIIntegrator::GradientThermostat
                                      ? 1
                                      : 2;
                for (int b = 0; b < loops.numBodies; b++)
                    if (loops.held[b])
                        ofHeld += draws * (all.set.rotor(b) == RotorKind::General  ? 6
                                           : all.set.rotor(b) == RotorKind::Linear ? 5
                                                                                   : 3);
                EXPECT_EQ(drawn + ofHeld, ofAll) << scheme;
                loops.settings.noise.step++;
                all.settings.noise.step++;
            }
            for (int b = 0; b < loops.numBodies; b++) {
                if (!loops.held[b]) {
                    EXPECT_EQ(loops.set.getStoredState(b), all.set.getStoredState(b)) << b;
                    EXPECT_NE(loops.set.getStoredState(b), start.set.getStoredState(b)) << b;
                    for (int p : loops.particles[b]) {
                        EXPECT_EQ(loops.of(loops.positions, p), all.of(all.positions, p));
                        EXPECT_EQ(loops.of(loops.velocities, p), all.of(all.velocities, p));
                    }
                    continue;
                }
                EXPECT_EQ(loops.set.getStoredState(b), start.set.getStoredState(b)) << b;
                Vec3 force;
                for (int p : loops.particles[b]) {
                    force += loops.of(loops.forces, p);
                    EXPECT_EQ(loops.of(loops.positions, p), start.of(start.positions, p));
                    EXPECT_EQ(loops.of(loops.lastPositions, p), Vec3(-1, -1, -1));
                    for (int k = 0; k < 3; k++) {
                        const double v = loops.velocities[3 * p + k];
                        if (hasMomenta) {
                            EXPECT_EQ(v, 0);
                            EXPECT_FALSE(signbit(v));
                            EXPECT_EQ(loops.lastVelocities[3 * p + k], 0);
                        } else
                            EXPECT_EQ(v, start.velocities[3 * p + k]);
                    }
                }
                EXPECT_LT(norm(loops.set.getForce_lab(b) - force), 1e-14);
            }
        }
}

TEST(HeldBodyLoops, TheFluidsPartsLeaveHeldBodiesToo) {
    for (bool packs : {false, true}) {
        const Scheme scheme = CustomRigidHIIntegrator::LangevinHI;
        Loops loops(true, scheme), all(false, scheme), start(true, scheme);
        for (BodyLoop part :
             {BodyLoop::BeforeFriction, BodyLoop::AfterFriction, BodyLoop::AfterForces}) {
            loops.run(part, packs);
            all.run(part, packs);
        }
        for (int b = 0; b < loops.numBodies; b++) {
            EXPECT_EQ(loops.set.getStoredState(b),
                      (loops.held[b] ? start : all).set.getStoredState(b));
            if (!loops.held[b]) {
                EXPECT_NE(loops.set.getStoredState(b), start.set.getStoredState(b));
            }
        }
    }
}

TEST(HeldBodyLoops, TakeInVelocitiesOfOthersOnly) {
    for (bool packs : {false, true})
        for (bool massesAreSites : {true, false})
            for (BodyLoop loop :
                 {BodyLoop::TakeInVelocities, BodyLoop::TakeInAndScatterVelocities}) {
                Loops loops(true, CustomRigidHIIntegrator::LangevinC, massesAreSites), start(true);
                loops.run(loop, packs);
                const bool scatters = loop == BodyLoop::TakeInAndScatterVelocities;
                for (int b = 0; b < loops.numBodies; b++) {
                    if (!loops.held[b]) {
                        EXPECT_EQ(loops.set.getState(b).p == start.set.getState(b).p,
                                  !massesAreSites);
                        continue;
                    }
                    EXPECT_TRUE(loops.set.blocks[loops.set.slot(b) / BodySet::blockSize]
                                    .massesMakeTheBodies);
                    EXPECT_EQ(loops.set.getStoredState(b), start.set.getStoredState(b));
                    for (int p : loops.particles[b])
                        EXPECT_EQ(loops.of(loops.velocities, p),
                                  scatters ? Vec3() : start.of(start.velocities, p));
                }
            }
}

TEST(HeldBodyLoops, ForcesOnHeldBodiesAreNoMidStepMomenta) {
    Loops loops(true), all(false);
    loops.run(BodyLoop::GatherForces, false);
    all.run(BodyLoop::GatherForces, false);
    const MidStepEnergies held = midStepEnergies(loops.set, loops.settings);
    // The others have those that they have by themselves: take momenta, forces and noise of those
    // that are held away.
    for (int b = 0; b < all.numBodies; b++)
        if (loops.held[b]) {
            const int s = all.set.slot(b);
            for (int k = 0; k < 3; k++)
                all.set.p[k][s] = all.set.l[k][s] = all.set.force_lab[k][s] = all.set.torque[k][s] =
                    0;
            all.set.setThermostat(b, Thermostat());
        }
    const MidStepEnergies others = midStepEnergies(all.set, all.settings);
    EXPECT_GT(others.translational, 1);
    EXPECT_NEAR(held.translational, others.translational, 1e-13 * others.translational);
    EXPECT_NEAR(held.rotational, others.rotational, 1e-13 * others.rotational);
    EXPECT_LT(norm(held.momentum - others.momentum), 1e-13);
}

// ---- Free particles ----

namespace {

/** Free particles beside one particle that is none, of which two may be held. */
struct FreeScene {
    System system;
    vector<int> indices = {1, 2, 3, 4, 5};
    ScalarLoops loops;
    StepSettings settings;
    vector<Vec3> positions, velocities, forces;
    unique_ptr<FreeParticles> free;

    FreeScene(Scheme scheme, const vector<int>& held) {
        for (int i = 0; i < 6; i++) {
            system.addParticle(i == 4 ? 0 : 1 + i);  // a massless one, which must be held
            positions.emplace_back(i, 2 * i, -i);
            velocities.emplace_back(0.1 * i, -0.3, 0.2);
            forces.emplace_back(1, -i, 0.5 * i);
        }
        free = make_unique<FreeParticles>(system, indices, nullptr);
        EXPECT_EQ(free->setHeld(held), !held.empty());
        EXPECT_FALSE(free->setHeld(held));
        settings.scheme = scheme;
        settings.h = 0.07;
        settings.kT = 1.3;
        settings.noise.seed = 5;
        HeatBath bath;
        bath.kT = settings.kT;
        bath.gamma = 2;
        bath.upsilon = 0.4;
        vector<Thermostat> thermostats;
        for (int i : indices) {
            BodyInertia point;
            point.mass = system.getParticleMass(i);
            thermostats.push_back(scalar::withThermostat(
                scheme, [&](auto named) { return named.coefficients(point, bath, settings.h); }));
            if (point.mass == 0) thermostats.back() = Thermostat();
        }
        free->setThermostats(thermostats);
        free->gatherForces(forces);
    }
    LoopResult step() {
        LoopResult result;
        if (settings.scheme == CustomRigidHIIntegrator::LangevinHI) {
            result.add(free->beforeFriction(settings, loops, positions, velocities, 1e-5));
            result.add(free->afterFriction(settings, loops, positions, velocities, 1e-5));
        } else
            result.add(free->beforeForces(settings, loops, positions, velocities, 1e-5));
        result.add(free->afterForces(settings, loops, positions, velocities, 1e-5));
        settings.noise.step++;
        return result;
    }
};

}  // namespace

TEST(HeldFreeParticles, StayAndOthersMoveAsEver) {
    vector<Scheme> schemes(begin(thermostatSchemes), end(thermostatSchemes));
    schemes.push_back(CustomRigidHIIntegrator::LangevinHI);
    for (Scheme scheme : schemes) {
        FreeScene some(scheme, {0, 2, 4, 17}), none(scheme, {}), start(scheme, {2, 4});
        EXPECT_EQ(some.free->getNumHeld(), 2);
        const double E = some.free->kineticEnergy(some.velocities);
        double expected = 0;
        for (int p : {1, 3, 5})
            expected += some.system.getParticleMass(p) * some.velocities[p].dot(some.velocities[p]);
        EXPECT_NEAR(E, expected / 2, 1e-14);
        for (int i = 0; i < 4; i++) {
            const LoopResult result = some.step(), all = none.step();
            EXPECT_TRUE(result.finite);
            EXPECT_EQ(result.randomNumbers * 4, all.randomNumbers * 3);  // the massless draws none
            if (scheme != CustomRigidHIIntegrator::LangevinHI) {
                EXPECT_GT(result.randomNumbers, 0);
            }
        }
        for (int p : {2, 4}) {
            EXPECT_EQ(some.positions[p], start.positions[p]);
            EXPECT_EQ(some.velocities[p], start.velocities[p]);  // as others have set it
        }
        for (int p : {1, 3, 5}) {
            EXPECT_EQ(some.positions[p], none.positions[p]);
            EXPECT_EQ(some.velocities[p], none.velocities[p]);
            EXPECT_NE(some.positions[p], start.positions[p]);
        }
        EXPECT_EQ(some.free->stopHeld(some.velocities), vector<int>({2, 4}));
        EXPECT_EQ(some.velocities[2], Vec3());
        EXPECT_EQ(some.velocities[4], Vec3());
        EXPECT_EQ(some.velocities[3], none.velocities[3]);
        EXPECT_TRUE(none.free->stopHeld(none.velocities).empty());
    }
}

TEST(HeldFreeParticles, HaveNoMidStepEnergy) {
    for (Scheme scheme : thermostatSchemes) {
        if (scheme == CustomRigidHIIntegrator::GradientThermostat) continue;
        FreeScene some(scheme, {2, 4});
        const double E =
            some.free->midStepKineticEnergy(some.settings, some.positions, some.velocities, 1e-5);
        FreeScene others(scheme, {2, 4});
        others.indices = {1, 3, 5};
        double expected = 0;
        for (int p : others.indices) {
            System one;
            for (int i = 0; i < 6; i++) one.addParticle(some.system.getParticleMass(i));
            FreeParticles alone(one, {p}, nullptr);
            BodyInertia point;
            point.mass = one.getParticleMass(p);
            HeatBath bath;
            bath.kT = some.settings.kT;
            bath.gamma = 2;
            alone.setThermostats({scalar::withThermostat(scheme, [&](auto named) {
                return named.coefficients(point, bath, some.settings.h);
            })});
            alone.gatherForces(some.forces);
            expected +=
                alone.midStepKineticEnergy(some.settings, some.positions, some.velocities, 1e-5);
        }
        EXPECT_NEAR(E, expected, 1e-13 * expected) << scheme;
    }
}

// ---- Momenta of a group in a fluid ----

namespace {

unique_ptr<MobilityModel> makeRpy(const HydrodynamicParticles& particles) {
    return make_unique<RotnePragerYamakawa>(particles, 0.7);
}

}  // namespace

TEST(HeldMomentumScaling, HasRowsOfOthersOnly) {
    // Body 0: a multiblob; 1 and 2: spheres; a free particle. Which are held is a bit mask.
    for (bool spheresOnly : {false, true})
        for (int mask : {0, 1, 2, 4, 8, 3, 10}) {
            const vector<Vec3> sites = spheresOnly
                                           ? vector<Vec3>{Vec3()}
                                           : vector<Vec3>{Vec3(), Vec3(0.9, 0, 0), Vec3(0, 1, 0.1)};
            vector<BodyGeometry> geometries(3);
            geometries[0] = {1.2, Vec3(0.4, 0.7, 0.5), sites};
            geometries[1] = {0.8, Vec3(0.3, 0.3, 0.2), {Vec3()}};
            geometries[2] = {2, Vec3(0.6, 0.5, 0.7), {Vec3()}};
            vector<vector<int>> particles = {{0, 1, 2}, {3}, {4}};
            particles[0].resize(sites.size());
            vector<bool> held;
            for (int b = 0; b < 3; b++) held.push_back(mask >> b & 1);
            BodySet set(geometries, particles, vector<vector<double>>(3),
                        vector<vector<bool>>{vector<bool>(3, true), {true}, {true}}, held);
            System system;
            for (int i = 0; i < 6; i++) system.addParticle(i == 5 ? 1.7 : 0.0);
            FreeParticles free(system, {5}, nullptr);
            free.setHeld(mask & 8 ? vector<int>{5} : vector<int>());
            vector<FluidElement> elements;
            for (int b = 0; b < 4; b++) {
                FluidElement e;
                if (b < 3) {
                    e.body = b;
                    e.particles = particles[b];
                    for (const Vec3& site : geometries[b].sites)
                        e.sites.push_back(toEigen(set.toInner(b, site)));
                } else {
                    e.particles = {5};
                    e.sites = {Vector3d::Zero()};
                }
                e.radii.assign(e.sites.size(), 0.5);
                if (mask >> b & 1) e.hold();
                elements.push_back(e);
            }
            TestedBodies bodies(elements, makeRpy);
            vector<Pose> poses(4);
            for (int b = 0; b < 4; b++) poses[b].R = Vector3d(2.1 * b, 0.7 * b * b, -0.3 * b);
            poses[0].q = {0.8, 0, 0.6, 0};
            poses[2].q = {0, 0.6, 0, 0.8};
            bodies.setPoses(poses);
            BodyMobility& mobility = bodies.byMatrices();
            MomentumScaling scaling(*bodies, {-1, -1, -1, 0}, set);
            EXPECT_TRUE(scaling.deadAxesAreNull());
            // T by columns, by hand.
            MatrixXd T = MatrixXd::Zero(21, 21);
            vector<int> rows;
            for (int b = 0; b < 4; b++) {
                const double m = b < 3 ? geometries[b].mass : 1.7;
                T.block<3, 3>(6 * b, 6 * b) = sqrt(m) * Matrix3d::Identity();
                for (int k = 0; k < 3 && b < 3; k++)
                    T.block<1, 3>(6 * b + 3 + k, 6 * b + 3) =
                        sqrt(set.inertia(b).moments[k]) * mobility.getTurn(b).col(k).transpose();
                EXPECT_EQ(scaling.firstRow(b), mask >> b & 1 ? -1 : (int)rows.size());
                for (int k = 0; k < (b < 3 ? 6 : 3) && !(mask >> b & 1); k++)
                    rows.push_back(6 * b + k);
            }
            ASSERT_EQ(scaling.getNumRows(), (int)rows.size());
            const MatrixXd whole = T.transpose().inverse() * mobility.friction() * T.inverse();
            MatrixXd expected(rows.size(), rows.size()), S, inverse;
            for (size_t i = 0; i < rows.size(); i++)
                for (size_t k = 0; k < rows.size(); k++) expected(i, k) = whole(rows[i], rows[k]);
            scaling.matrix(false, mobility, set, free, S);
            EXPECT_LT(difference(S, expected), 1e-13) << mask;
            // The inverse is made from the mobility beside what is held, not from a block of N.
            scaling.matrix(true, mobility, set, free, inverse);
            EXPECT_LT((inverse * S - MatrixXd::Identity(S.rows(), S.rows())).norm(), 1e-11) << mask;
            // Columns there and back: products with T^T and T on the rows of others.
            const MatrixXd x = MatrixXd::Random(rows.size(), 2), twists = MatrixXd::Random(21, 2);
            MatrixXd wrenches, y, xOfAll = MatrixXd::Zero(21, 2);
            for (size_t i = 0; i < rows.size(); i++) xOfAll.row(rows[i]) = x.row(i);
            scaling.wrenches(x, mobility, set, free, wrenches);
            scaling.scaled(twists, mobility, set, free, y);
            EXPECT_LT((wrenches - T.transpose() * xOfAll).norm(), 1e-13);
            ASSERT_EQ(y.rows(), (int)rows.size());
            for (size_t i = 0; i < rows.size(); i++)
                EXPECT_LT((y.row(i) - (T * twists).row(rows[i])).norm(), 1e-13);
        }
}

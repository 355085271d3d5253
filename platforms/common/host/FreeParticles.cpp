#include "host/FreeParticles.h"

#include <openmm/HarmonicAngleForce.h>
#include <openmm/reference/ReferenceConstraints.h>

#include <cmath>
#include <set>

#include "host/BodyLoops-inl.h"
#include "schemes/MomentumFlow.h"

using namespace OpenMM;
using namespace std;

namespace RigidHIPlugin {

FreeParticles::FreeParticles(const System& system, const vector<int>& particles,
                             ReferenceConstraints* ofContext)
    : particles(particles), held(particles.size(), false), thermostats(particles.size()),
      forces(particles.size()) {
    vector<bool> isFree(system.getNumParticles(), false);
    inverseMasses.assign(system.getNumParticles(), 0.0);
    for (int p : particles) {
        isFree[p] = true;
        masses.push_back(system.getParticleMass(p));
        inverseMasses[p] = masses.back() > 0 ? 1 / masses.back() : 0;
    }
    const auto forEach = [&](auto action) {
        for (int i = 0; i < system.getNumConstraints(); i++) {
            int a, b;
            double distance;
            system.getConstraintParameters(i, a, b, distance);
            if (isFree[a] && isFree[b]) action(a, b, distance);
        }
    };
    forEach([&](int, int, double) { numConstraints++; });
    if (numConstraints == 0) return;
    // The time to make OpenMM's algorithm is quadratic in constraints. If the System has no other
    // constraints, use the Context's algorithm.
    constraints = ofContext;
    if (constraints && numConstraints == system.getNumConstraints()) return;
    // The Context's own constraints would also apply the constraints within rigid bodies. OpenMM's
    // algorithms therefore get a System made here.
    constraintSystem = make_unique<System>();
    for (int i = 0; i < system.getNumParticles(); i++)
        constraintSystem->addParticle(system.getParticleMass(i));
    forEach(
        [&](int a, int b, double distance) { constraintSystem->addConstraint(a, b, distance); });
    for (int i = 0; i < system.getNumForces(); i++)  // they help the constraint matrix to converge
        if (auto* angles = dynamic_cast<const HarmonicAngleForce*>(&system.getForce(i)))
            constraintSystem->addForce(new HarmonicAngleForce(*angles));
    ownConstraints = make_unique<ReferenceConstraints>(*constraintSystem);
    constraints = ownConstraints.get();
}

FreeParticles::~FreeParticles() = default;

bool FreeParticles::setHeld(const vector<int>& particlesOfSystem) {
    const set<int> wanted(particlesOfSystem.begin(), particlesOfSystem.end());
    const vector<char> before = held;
    numHeld = 0;
    for (size_t i = 0; i < particles.size(); i++) {
        held[i] = wanted.count(particles[i]) != 0;
        numHeld += held[i];
    }
    return held != before;
}

vector<int> FreeParticles::stopHeld(vector<Vec3>& velocities) const {
    vector<int> stopped;
    for (size_t i = 0; numHeld > 0 && i < particles.size(); i++)
        if (held[i]) {
            velocities[particles[i]] = Vec3();
            stopped.push_back(particles[i]);
        }
    return stopped;
}

void FreeParticles::setThermostats(const vector<Thermostat>& perParticle) {
    thermostats = perParticle;
    // The fluid itself draws noise for the particles that it couples. No code draws noise twice.
    noisyParticles.clear();
    noiseOf.assign(particles.size(), -1);
    for (size_t i = 0; i < particles.size(); i++)
        if (thermostats[i].hasNoise() && !held[i]) {
            noiseOf[i] = noisyParticles.size();
            noisyParticles.push_back(particles[i]);
        }
}

bool FreeParticles::gatherForces(const vector<Vec3>& contextForces) {
    double sum = 0;
    for (size_t i = 0; i < particles.size(); i++) {
        forces[i] = contextForces[particles[i]];
        sum += forces[i][0] + forces[i][1] + forces[i][2];
    }
    return isfinite(sum);
}

double FreeParticles::kineticEnergy(const vector<Vec3>& velocities) const {
    double sum = 0;
    for (size_t i = 0; i < particles.size(); i++)
        if (!held[i]) sum += masses[i] * velocities[particles[i]].dot(velocities[particles[i]]);
    return 0.5 * sum;
}

double FreeParticles::midStepKineticEnergy(const StepSettings& settings, vector<Vec3>& positions,
                                           vector<Vec3> velocities, double constraintTolerance) {
    const int numMovable = particles.size() - numHeld;
    if (numMovable == 0) return 0;
    double noise = 0;
    scalar::withThermostat(settings.scheme, [&](auto scheme) {
        for (size_t i = 0; i < particles.size(); i++) {
            if (held[i]) continue;
            const auto flow = MomentumFlow::upToDrift<decltype(scheme)>(
                thermostats[i].decay_p, thermostats[i].noise_p, settings.h);
            Vec3& v = velocities[particles[i]];
            v = v * flow.factor + forces[i] * (flow.time / masses[i]);
            noise += 1.5 * flow.variance() / masses[i];
        }
    });
    // The moves keep relative velocities along constraints at 0. To constrain once after all moves
    // has the same result as to constrain after each. Each constraint takes the noise of one degree
    // of freedom.
    if (constraints)
        constraints->applyToVelocities(positions, velocities, inverseMasses, constraintTolerance);
    const double degrees = 3.0 * numMovable;
    return kineticEnergy(velocities) + noise * (degrees - numConstraints) / degrees;
}

void FreeParticles::save(Snapshot& snapshot, const vector<Vec3>& positions,
                         const vector<Vec3>& velocities) const {
    if (particles.empty()) return;
    snapshot.positions.resize(particles.size());
    snapshot.velocities.resize(particles.size());
    snapshot.forces = forces;
    for (size_t i = 0; i < particles.size(); i++) {
        snapshot.positions[i] = positions[particles[i]];
        snapshot.velocities[i] = velocities[particles[i]];
    }
}

void FreeParticles::restore(const Snapshot& snapshot, vector<Vec3>& positions,
                            vector<Vec3>& velocities) {
    if (particles.empty()) return;
    forces = snapshot.forces;
    for (size_t i = 0; i < particles.size(); i++) {
        positions[particles[i]] = snapshot.positions[i];
        velocities[particles[i]] = snapshot.velocities[i];
    }
}

void FreeParticles::restore(const Snapshot& snapshot, int i, vector<Vec3>& positions) {
    forces[i] = snapshot.forces[i];
    positions[particles[i]] = snapshot.positions[i];
}

/**
 * The moves of which schemes consist, for all free particles. Velocities take the place of momenta.
 */
class FreeParticles::Flow {
public:
    Flow(FreeParticles& owner, const StepSettings& settings, PlatformLoops& loops,
         vector<Vec3>& positions, vector<Vec3>& velocities, double tolerance)
        : owner(owner), settings(settings), loops(loops), positions(positions),
          velocities(velocities), tolerance(tolerance) {}
    void kick(double t) {
        each(
            [&](int i, int p) { velocities[p] += owner.forces[i] * (t * owner.inverseMasses[p]); });
        constrainVelocities();
    }
    void drift(double t) {
        if (!owner.constraints) {
            each([&](int i, int p) { positions[p] += velocities[p] * t; });
            return;
        }
        owner.before = positions;
        each([&](int i, int p) { positions[p] += velocities[p] * t; });
        owner.after = positions;
        owner.constraints->apply(owner.before, positions, owner.inverseMasses, tolerance);
        each([&](int i, int p) { velocities[p] += (positions[p] - owner.after[p]) * (1 / t); });
        constrainVelocities();
    }
    void damp() {
        each([&](int i, int p) { velocities[p] *= owner.thermostats[i].decay_p; });
    }
    void addNoise(int draw) {
        if (owner.noisyParticles.empty()) return;
        drawNoise(draw);
        each([&](int i, int p) {
            if (owner.noiseOf[i] >= 0)
                velocities[p] += xi(i) * (owner.thermostats[i].noise_p * owner.inverseMasses[p]);
        });
        constrainVelocities();
    }
    void ornsteinUhlenbeck(int draw) {
        damp();
        addNoise(draw);
    }
    void gradientMove(int draw) {
        if (!owner.noisyParticles.empty()) drawNoise(draw);
        each([&](int i, int p) {
            positions[p] += owner.forces[i] * owner.thermostats[i].move_R;
            if (owner.noiseOf[i] >= 0) positions[p] += xi(i) * owner.thermostats[i].noise_R;
        });
    }
    LoopResult result() const {
        LoopResult r;
        double sum = 0;
        for (int p : owner.particles) {
            const Vec3 &x = positions[p], &v = velocities[p];
            sum += x[0] + x[1] + x[2] + v[0] + v[1] + v[2];
        }
        r.finite = isfinite(sum);
        r.randomNumbers = randomNumbers;
        return r;
    }

private:
    template <class Move>
    void each(Move move) {
        loops.forRanges(owner.particles.size(), [&](int first, int end) {
            for (int i = first; i < end; i++)
                if (!owner.held[i]) move(i, owner.particles[i]);
        });
    }
    void constrainVelocities() {
        if (owner.constraints)
            owner.constraints->applyToVelocities(positions, velocities, owner.inverseMasses,
                                                 tolerance);
    }
    void drawNoise(int draw) {
        const int count = owner.noisyParticles.size();
        owner.noise.resize(3 * count);
        loops.fillNoise(settings.noise,
                        draw == 0 ? NoiseStream::FreeFirstDraw : NoiseStream::FreeSecondDraw,
                        owner.noisyParticles.data(), count, owner.noise.data());
        randomNumbers += 3 * count;
    }
    Vec3 xi(int i) const {
        const double* numbers = &owner.noise[3 * owner.noiseOf[i]];
        return Vec3(numbers[0], numbers[1], numbers[2]);
    }
    FreeParticles& owner;
    const StepSettings& settings;
    PlatformLoops& loops;
    vector<Vec3>&positions, &velocities;
    const double tolerance;
    long long randomNumbers = 0;
};

LoopResult FreeParticles::beforeForces(const StepSettings& settings, PlatformLoops& loops,
                                       vector<Vec3>& positions, vector<Vec3>& velocities,
                                       double tolerance) {
    if (particles.empty()) return {};
    Flow flow(*this, settings, loops, positions, velocities, tolerance);
    scalar::withThermostat(settings.scheme,
                           [&](auto scheme) { scheme.beforeForces(flow, settings.h); });
    return flow.result();
}

LoopResult FreeParticles::beforeFriction(const StepSettings& settings, PlatformLoops& loops,
                                         vector<Vec3>& positions, vector<Vec3>& velocities,
                                         double tolerance) {
    if (particles.empty()) return {};
    Flow flow(*this, settings, loops, positions, velocities, tolerance);
    scalar::withFluidThermostat(settings.scheme,
                                [&](auto scheme) { scheme.beforeFriction(flow, settings.h); });
    return flow.result();
}

LoopResult FreeParticles::afterFriction(const StepSettings& settings, PlatformLoops& loops,
                                        vector<Vec3>& positions, vector<Vec3>& velocities,
                                        double tolerance) {
    if (particles.empty()) return {};
    Flow flow(*this, settings, loops, positions, velocities, tolerance);
    scalar::withFluidThermostat(settings.scheme,
                                [&](auto scheme) { scheme.afterFriction(flow, settings.h); });
    return flow.result();
}

LoopResult FreeParticles::afterForces(const StepSettings& settings, PlatformLoops& loops,
                                      vector<Vec3>& positions, vector<Vec3>& velocities,
                                      double tolerance) {
    if (particles.empty()) return {};
    Flow flow(*this, settings, loops, positions, velocities, tolerance);
    scalar::withThermostat(settings.scheme,
                           [&](auto scheme) { scheme.afterForces(flow, settings.h); });
    return flow.result();
}

}  // namespace RigidHIPlugin

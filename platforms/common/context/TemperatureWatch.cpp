#include "context/TemperatureWatch.h"

#include <openmm/OpenMMException.h>
#include <openmm/reference/SimTKOpenMMRealType.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "context/Scene.h"
#include "fluid/StepResolution.h"
#include "openmmrigidhi/internal/Messages.h"

using namespace OpenMM;
using namespace std;

namespace RigidHIPlugin {

namespace {

// The length of a window: at least this number of steps, and of relaxation times.
const double shortestWindow = 4000, relaxationTimes = 20;
// Relative errors of temperatures that right steps may have. In water at 7 fs, where energies are
// right, translation is 2 % cold and rotation 4 % hot; at 9 fs, where the energy is 3 % off,
// rotation is 13 to 19 % hot (docs/theory/thermostats.md). Rotors are not harmonic.
const double translationalBand = 0.05, rotationalBand = 0.10;
// Added to the band. A right run exceeds one of the four bounds of a window less often than once in
// 10^6 windows.
const double standardErrors = 5;
// Short windows, after one of which the heat of the start has decayed to a few thousandths.
const double fewestLooks = 4, relaxationTimesOfShort = 4, bandOfShort = 0.3;
// A run has exploded if kinetic energies are this many times those of a hot bath, kJ/mol, and
// bodies moreover move farther than their size, or this length, in nm, in a step, or turn by this
// angle.
const double exploded = 1e4, hotBath = 300 * BOLTZ, shortest = 0.3, wildTurn = 6;
// Bodies that move together in a fluid feel less friction than each of them alone.
const double together = 0.5;

/**
 * A bound of a mean of squares of Gaussian numbers, relative to its expected value (Wilson and
 * Hilferty 1931). With many numbers it is 1 + errors sqrt(variance).
 */
double boundOfSquares(double relativeVariance, double errors) {
    const double x = relativeVariance / 9;
    return pow(max(0.0, 1 - x + errors * sqrt(x)), 3);
}

/** A temperature with three digits, or with more if these would not reach one kelvin. */
string temperatureText(double T) { return text(T, max(3, 1 + (int)log10(max(T, 1.0)))); }

}  // namespace

void TemperatureWatch::Expectation::add(int number, double relaxation, double energyOfEach) {
    degrees += number;
    energy += number * energyOfEach;
    perRate += number / relaxation;
}

bool TemperatureWatch::Expectation::isTooHigh(double found, double band, double windows) const {
    return found > energy * (band + boundOfSquares(relativeVariance / windows, standardErrors));
}

bool TemperatureWatch::Expectation::isTooLow(double found, double band, double windows) const {
    return found < energy * (boundOfSquares(relativeVariance / windows, -standardErrors) - band);
}

void TemperatureWatch::adopt(const Scene& scene) {
    restart();
    isOn = false;
    const StepSettings& settings = scene.settings;
    const BodySet& bodies = scene.bodies;
    const bool inFluid = settings.traits().needsFluid();
    if (!settings.hasMomenta() || settings.kT == 0 || bodies.getNumMovable() == 0 ||
        scene.bodyForces.usesTime() || scene.bodyForces.usesVelocities() ||
        scene.bodyMotions.isOn() || (inFluid && scene.fluid->getContents().getFlow()))
        return;
    translation = rotation = Expectation();
    totalMass = totalMoment = largestSize = 0;
    double slowest = numeric_limits<double>::infinity();
    const auto expect = [&](Expectation& motion, int number, double inertia, double decay,
                            double noise, double rateInFluid) {
        FreeMomentum momentum = freeMomentum(settings, inertia, decay, noise);
        if (momentum.relaxation == 0) momentum.relaxation = rateInFluid * settings.h;
        slowest = min(slowest, momentum.relaxation);
        motion.add(number, momentum.relaxation, 0.5 * settings.kT * momentum.ratio);
    };
    for (int b = 0; b < bodies.getNumBodies(); b++) {
        if (bodies.isHeld(b)) continue;
        const BodyInertia& inertia = bodies.inertia(b);
        const int s = bodies.slot(b);
        BodyRates fluid;
        if (inFluid && bodies.decay_p[s] == 1)
            fluid = findRates(scene.fluid->getContents(), b, inertia);
        totalMass += inertia.mass;
        const double moments = inertia.moments[0] + inertia.moments[1] + inertia.moments[2];
        totalMoment += moments;
        largestSize = max(largestSize, sqrt(2 * moments / inertia.mass));
        expect(translation, 3, inertia.mass, bodies.decay_p[s], bodies.noise_p[s],
               together * fluid.translation);
        for (int k = 0; k < 3; k++)
            if (inertia.isLive(k))
                expect(rotation, 1, inertia.moments[k], bodies.decay_l[k][s], bodies.noise_l[k][s],
                       together * fluid.rotation[k]);
    }
    if (!(slowest > 0)) return;
    isOn = true;
    noise = midStepEnergiesOfNoise(bodies, settings);
    removed = scene.stock.hasCMMotionRemover ? 3 : 0;
    // A window has a whole number of looks, which an integer can hold.
    const double largest = 1e18;
    const double looksOfWindow =
        ceil(min(largest, max(shortestWindow, relaxationTimes / slowest)) / interval);
    window = interval * (long long)looksOfWindow;
    shortWindow =
        interval * (long long)ceil(
                       min(largest, max(fewestLooks, relaxationTimesOfShort / slowest / interval)));
    // A kinetic energy decorrelates in half a relaxation time. Its mean over n relaxation times has
    // the relative variance 2/n, and so has its mean over n looks. The sum bounds both.
    for (Expectation* motion : {&translation, &rotation})
        if (motion->degrees > 0)
            motion->relativeVariance =
                2 * (motion->perRate / window + motion->degrees / looksOfWindow) /
                ((double)motion->degrees * motion->degrees);
}

void TemperatureWatch::restart() {
    steps = looks = windows = looksOfShort = 0;
    sum = sumOfWindows = sumOfShort = MidStepEnergies();
    finding.clear();
}

namespace {

void add(const MidStepEnergies& energies, MidStepEnergies& sum) {
    sum.translational += energies.translational;
    sum.rotational += energies.rotational;
    sum.momentum += energies.momentum;
}

}  // namespace

/**
 * Look for an explosion, which needs no statistics. Energies alone tell too little, because heavy
 * bodies that a force drives have large ones. @throws OpenMMException if the run has exploded
 */
void TemperatureWatch::lookForExplosion(const Scene& scene, const MidStepEnergies& now) const {
    const double h = scene.settings.h, reference = exploded * max(1.0, hotBath / scene.settings.kT);
    const auto fail = [&](const char* motion, const Expectation& expected, double energy) {
        throw OpenMMException(
            "CustomRigidHIIntegrator: the run has exploded: " + string(motion) +
            " of bodies are at " +
            temperatureText(scene.settings.kT / BOLTZ * energy / expected.energy) +
            " K after a step of " + number(h) +
            " ps; the step is too long, or particles overlap: begin with "
            "openmmrigidhi.app.minimize(), and take a smaller step. The Context holds the state "
            "after this step");
    };
    if (now.translational > reference * translation.energy &&
        h * sqrt(2 * now.translational / totalMass) > max(shortest, largestSize))
        fail("translations", translation, now.translational);
    if (rotation.degrees > 0 && now.rotational > reference * rotation.energy &&
        h * sqrt(2 * now.rotational / totalMoment) > wildTurn)
        fail("rotations", rotation, now.rotational);
}

void TemperatureWatch::look(const Scene& scene, const MidStepEnergies& now) {
    lookForExplosion(scene, now);
    if (steps > shortWindow) {
        add(now, sumOfShort);
        looksOfShort++;
        if (steps % shortWindow == 0) {
            string former;
            swap(finding, former);
            judge(scene, sumOfShort, looksOfShort, double(shortWindow) / window, bandOfShort);
            if (finding.empty()) swap(finding, former);
            looksOfShort = 0;
            sumOfShort = MidStepEnergies();
        }
    }
    if (steps <= window) return;  // the scene may relax first
    add(now, sum);
    looks++;
    if (steps % window != 0) return;
    // Changes appear in the last window, and small errors in all windows together.
    windows++;
    add(sum, sumOfWindows);
    finding.clear();
    judge(scene, sum, looks, 1, 0);
    if (finding.empty() && windows > 1)
        judge(scene, sumOfWindows, double(looks) * windows, windows, 0);
    looks = 0;
    sum = MidStepEnergies();
}

void TemperatureWatch::judge(const Scene& scene, const MidStepEnergies& energies, double looksOfSum,
                             double number, double leastBand) {
    const double mean = 1 / looksOfSum, band_t = max(translationalBand, leastBand),
                 band_r = max(rotationalBand, leastBand), kT = scene.settings.kT, bath = kT / BOLTZ;
    const double translational = mean * energies.translational + noise.translational,
                 rotational = mean * energies.rotational + noise.rotational;
    // Bodies that a constant force drives have a mean velocity, which is no heat.
    const Vec3 momentum = energies.momentum * mean;
    const double heat = translational - 0.5 * momentum.dot(momentum) / totalMass;
    // A CMMotionRemover takes some motion away, but between two removals all of it may be present.
    const double least = translation.degrees - removed;
    const auto report = [&](const char* motion, double degrees, double energy, double expected) {
        const double T = 2 * energy / (BOLTZ * degrees);
        finding += (finding.empty() ? "" : ", and ") + string(motion) + temperatureText(T) +
                   " K instead of " + temperatureText(bath * expected) + " K";
    };
    const double expected_t = 2 * translation.energy / (kT * translation.degrees);
    if (translation.isTooHigh(heat, band_t, number))
        report("translations of bodies have been at ", translation.degrees, heat, expected_t);
    else if (translation.isTooLow(translational * translation.degrees / max(least, 1.0), band_t,
                                  number) &&
             least > 0)
        report("translations of bodies have been at ", least, translational, expected_t);
    if (rotation.isTooHigh(rotational, band_r, number) ||
        rotation.isTooLow(rotational, band_r, number))
        report("rotations of bodies have been at ", rotation.degrees, rotational,
               2 * rotation.energy / (kT * rotation.degrees));
    if (!finding.empty())
        finding = "over the last " + to_string(llround(number * window)) + " steps (" +
                  text(number * window * scene.settings.h, 4) + " ps) " + finding +
                  ": the step is too long, or forces are not conservative or drive bodies; take a "
                  "smaller step (computeMidStepTemperature() shows this temperature)";
}

}  // namespace RigidHIPlugin

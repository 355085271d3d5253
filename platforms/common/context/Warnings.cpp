#include "context/Warnings.h"

#include <openmm/reference/SimTKOpenMMRealType.h>

#include <algorithm>
#include <cmath>

#include "context/FluidMismatches.h"
#include "context/MemberMismatches.h"
#include "context/Messages.h"
#include "context/Mismatches.h"
#include "context/Scene.h"
#include "fluid/FluidReport.h"
#include "fluid/StepResolution.h"
#include "fluid/StepWatch.h"
#include "openmmrigidhi/internal/Messages.h"

using namespace std;

namespace RigidHIPlugin {

namespace {

// The limit above which the schemes of Davidchack 2015 stop resolving a body's fast rotation
// (measured; docs/CONVENTIONS.md).
const double resolutionLimit = 0.1;
// Davidchack 2015, section VI: Langevin A breaks down above about these rates, 1/ps.
const double langevinAGammaLimit = 100, langevinARotationalLimit = 200;

/**
 * Steps longer than this part of the smallest radius, or than this turn, miss what they should
 * resolve.
 */
const double largestDisplacement = 0.5, largestTurn = 0.5;
/** Turn of a step at the thermal angular velocity, in radians, for bodies with momenta. */
const double largestThermalTurn = 1;
/** The step over a time of relaxation with which averages are right to about five percent. */
const double wellResolved = 0.1;
/** The largest strain of a step in a driven flow. setShear() refuses larger ones than 0.1. */
const double largestStrain = 0.5;
/**
 * At h s = 0.5 free diffusion is 2 % too fast: D/D0 = (h s/2) coth(h s/2), s the rate of
 * relaxation.
 */
const double largestRelaxation = 0.5;
/** A step that takes longer by matrices, where iterations would take a fraction of it, is slow. */
const double secondsToWarnOf = 1;
/** A few steps in a thousand may be redone. */
const double largestPartRedone = 0.005;

string percent(double part) { return text(100 * part, 2) + " %"; }

/** A step to recommend: three digits, rounded down, so that this step causes no warning itself. */
string shorter(double step) {
    const double digit = pow(10, floor(log10(step)) - 2);
    return number(floor(step / digit * (1 - 1e-9)) * digit);
}

/** A length in the unit in which it is a number from 1 to 1000. */
string lengthText(double nm) {
    const struct {
        double size;
        const char* name;
    } units[] = {{1e12, " km"}, {1e9, " m"}, {1e6, " mm"}, {1e3, " um"}, {1, " nm"}, {1e-3, " pm"}};
    for (const auto& unit : units)
        if (nm >= unit.size) return text(nm / unit.size, 3) + unit.name;
    return text(nm, 3) + " nm";
}

/** The step with the wanted random motion, which grows with the root of the step. */
double stepFor(double h, double wanted, double found) {
    return h * wanted * wanted / (found * found);
}

string longTurn(double h, const string& body, double turn) {
    return "in a step of " + number(h) + " ps " + body + " turns at random by " + text(turn, 3) +
           " rad about an axis, above " + number(largestTurn) +
           ": the step does not resolve its rotation; take a step of " +
           shorter(stepFor(h, largestTurn, turn)) + " ps or less";
}

/** Compare the displacements and turns of a step without momenta with what it should resolve. */
void warnOfLeaps(const Scene& scene, double h, double kT, Warnings& result) {
    const StepResolution step =
        resolveOverdamped(scene.fluid->getContents(), scene.integrator.getScheme(), h, kT);
    if (step.displacement > largestDisplacement * step.smallestRadius)
        result[WarningCause::LongDisplacement] =
            "in a step of " + number(h) + " ps " + step.mover + " moves at random by " +
            lengthText(step.displacement) + " along each axis, where the smallest radius is " +
            lengthText(step.smallestRadius) +
            ": such steps leap over other bodies and over the ranges of forces; take a step of " +
            shorter(stepFor(h, largestDisplacement * step.smallestRadius, step.displacement)) +
            " ps or less, and check that radii are in nm, the viscosity in dalton/(nm ps) and the "
            "step in ps";
    if (step.turn > largestTurn)
        result[WarningCause::LongTurn] = longTurn(h, step.turner, step.turn);
    const StepFinding stiff = findStiffForces(scene.fluid->getContents());
    if (!stiff.name.empty())
        result[WarningCause::StiffForces] =
            "the step of " + number(h) + " ps " + (stiff.isPast ? "was for some time " : "is ") +
            text(stiff.value, 3) + " times the time in which " + stiff.name +
            " relaxes in the forces on it, above " + number(StepWatch::largestRelaxation) +
            ": the step does not resolve these forces, so that averages may be wrong, and far "
            "longer "
            "steps diverge; take a step of about " +
            shorter(h * wellResolved / stiff.value) + " ps, or softer forces";
    const StepFinding drive = findLongDisplacements(scene.fluid->getContents());
    if (!drive.name.empty())
        result[WarningCause::LongDrive] =
            "in a step of " + number(h) + " ps forces or slips " +
            (drive.isPast ? "have moved " : "move ") + drive.name + " by " +
            lengthText(drive.value) + " relative to the others, where the smallest radius is " +
            lengthText(drive.smallestRadius) +
            ": such steps leap over other bodies and over the ranges of forces; take a step of " +
            shorter(h * StepWatch::largestMeanDisplacement * drive.smallestRadius / drive.value) +
            " ps or less, and check the units of forces, slips and the step";
    const StepFinding crawling = findCrawling(scene.fluid->getContents());
    if (!crawling.name.empty())
        result[WarningCause::ShortStep] =
            "in a step of " + number(h) + " ps nothing moves by more than " +
            text(crawling.value, 2) + " of the smallest radius, " +
            lengthText(crawling.smallestRadius) +
            ", so that random motion over this radius takes " +
            text(pow(max(crawling.value, 1e-10), -2), 1) +
            " steps or more; take a longer step, and check that radii are in nm, the viscosity in "
            "dalton/(nm ps) and the step in ps";
    const DrivenFlow* flow = scene.fluid->getContents().getFlow();
    const double strain = flow ? h * flow->largestGradient() : 0;
    if (strain > largestStrain)
        result[WarningCause::StrainOfFlow] =
            "in a step of " + number(h) + " ps the driven flow strains the fluid by " +
            text(strain, 3) + ", above " + number(largestStrain) +
            ": the step does not resolve how bodies move past each other; take a step of " +
            shorter(h * largestStrain / strain) + " ps or less";
    if (!step.driven.empty())
        result[WarningCause::DrivenSpin] =
            "forces keep turning " + step.driven + " about its fastest axis, but the step of " +
            number(h) + " ps does not resolve this rotation, which has " + text(step.slowing, 3) +
            " of its real mobility (describeEffects(), \"slowed spins\"); take away the torque "
            "about this axis, or take a step of " +
            shorter(step.longestStepOfDriven) +
            " ps or less, with which the rotation has its real mobility";
}

/** Bodies that turn by more than a radian between two forces, also those that turn freely. */
void warnOfFastTurns(const Scene& scene, double h, double kT, Warnings& result) {
    double largest = 0;
    int count = 0, first = -1;
    for (int b = 0; b < scene.bodies.getNumBodies(); b++) {
        if (scene.bodies.isHeld(b)) continue;
        const BodyInertia& inertia = scene.bodies.inertia(b);
        // About the axis of its smallest moment an elongated body may turn as it likes.
        double moments[3];
        copy(inertia.moments, inertia.moments + 3, moments);
        sort(moments, moments + 3);
        if (moments[1] == 0) continue;
        const double turn = h * sqrt(kT / moments[1]);
        if (!(turn > largestThermalTurn)) continue;
        if (count++ == 0) first = b;
        largest = max(largest, turn);
    }
    if (count > 0)
        result[WarningCause::UnresolvedRotation] =
            "in a step of " + number(h) + " ps " + counted(count, "body turns", "bodies turn") +
            " by up to " + text(largest, 3) + " rad at thermal speeds (the first is body " +
            to_string(first) + "), so that forces do not see how bodies turn; take a step of " +
            shorter(h * 0.1 / largest) +
            " ps or less, and check that the step is in ps and moments in dalton nm^2";
}

/**
 * Turns of the gradient thermostat: q <- q exp(b eta), with b^2 = 2 h Upsilon kT/M, turns by 2 b.
 */
void warnOfTurns(const Scene& scene, double h, double kT, Warnings& result) {
    double smallest = INFINITY;
    int first = -1;
    for (int b = 0; b < scene.bodies.getNumBodies(); b++) {
        const double M = scene.bodies.inertia(b).M();
        if (scene.bodies.isHeld(b) || M == 0 || M >= smallest) continue;
        smallest = M;
        first = b;
    }
    const double Upsilon = scene.integrator.getGradientRotationalRelaxationTime(),
                 turn = first < 0 ? 0 : 2 * sqrt(2 * h * Upsilon * kT / smallest);
    if (turn > largestTurn)
        result[WarningCause::LongTurn] = longTurn(h, "body " + to_string(first), turn);
}

/**
 * LangevinA adds the same random numbers, in the body's frame, before and after the body turns. If
 * in between the body has turned by random angles of variance s^2, the noise on the other axes has
 * (1 + exp(-s^2/2))/2 of its variance, and they are too cold.
 */
void warnOfSpinUnderLangevinA(const Scene& scene, double h, double kT, Warnings& result) {
    double largest = 0, noise = 0;
    int spinner = -1;
    for (int b = 0; b < scene.bodies.getNumBodies(); b++) {
        if (scene.bodies.rotor(b) != RotorKind::General) continue;
        double gamma, Gamma;
        scene.integrator.getBodyFriction(b, gamma, Gamma);
        const double spin = h * sqrt(kT / scene.bodies.inertia(b).moments[0]);
        if (Gamma == 0 || spin <= largest) continue;
        largest = spin;
        noise = (1 + exp(-spin * spin / 2)) / 2;
        spinner = b;
    }
    const double limit = 0.5;
    if (largest > limit)
        result[WarningCause::SpinUnderLangevinA] =
            "body " + to_string(spinner) + " spins by " + text(largest, 3) + " rad in a step of " +
            number(h) + " ps, above " + number(limit) +
            ", so that the noise of the two halves of LangevinA's step is not along the same axes: "
            "its other rotations have about " +
            text(noise, 2) + " of the temperature; use LangevinB or LangevinC, or a step of " +
            shorter(h * limit / largest) + " ps or less";
}

/**
 * Momenta that relax within a step of LangevinHI: temperatures are right, but displacements are
 * not.
 */
void warnOfRelaxation(const Scene& scene, double h, Warnings& result) {
    const StepResolution step =
        resolveRelaxation(scene.fluid->getContents(), h, scene.bodies, *scene.freeParticles);
    const double x = step.relaxation;
    if (!(x > largestRelaxation)) return;
    result[WarningCause::FastRelaxation] =
        "the step of " + number(h) + " ps is " + text(x, 3) + " times the time in which " +
        (step.relaxationIsOfRotation ? "the angular momentum of " : "the momentum of ") +
        step.fastestToRelax + " relaxes: temperatures are right, but its " +
        (step.relaxationIsOfRotation ? "rotational " : "") + "diffusion is " +
        text(x / 2 / tanh(x / 2), 3) + " times as fast as it should be; take a step of " +
        shorter(h * largestRelaxation / x) +
        " ps or less, or a scheme without momenta (such as TrapezoidalSlip), whose step has "
        "limits of its own";
}

/** Lubrication can take matrices whose columns are products on a grid. Steps then take seconds. */
void warnOfMatricesByColumns(const Scene& scene, double kT, Warnings& result) {
    const FluidContents& fluid = scene.fluid->getContents();
    double seconds = 0;
    for (const auto& group : fluid.groups)
        seconds += kT > 0 ? group->columns.withNoise : group->columns.withoutNoise;
    if (!(seconds > secondsToWarnOf)) return;
    const SchemeTraits& traits = traitsOf(scene.integrator.getScheme());
    string cause = "these bodies take", remedy = "use setLubrication(False)";
    if (!traits.takesIterations()) {
        cause = string(traits.name) + " takes";
        remedy = "use TractionEulerMaruyama, which iterates, or setLubrication(False)";
    } else if (fluid.force.getMinimumGap() > 0) {
        cause = "setMinimumGap(" + number(fluid.force.getMinimumGap()) + ") takes";
        remedy = "use setMinimumGap(0), with which the scheme iterates, or setLubrication(False)";
    }
    result[WarningCause::MatricesByColumns] =
        "with lubrication " + cause +
        " matrices, and along these walls each column of a matrix of ForceCoupling is a product on "
        "the grid: a step is estimated to take " +
        text(seconds, 2) + " s on one thread of the CPU platform; " + remedy +
        " (setSolver(Dense) accepts such steps without this warning)";
}

/** The part of all steps so far that were redone, if it is surely too large; else 0. */
double partRedoneSoFar(const Scene& scene) {
    if (scene.counters.rejectedSteps == 0 || !scene.fluid) return 0;
    return scene.settings.traits().isOverdamped()
               ? partRedone(scene.fluid->getContents(), largestPartRedone)
               : partRedone(scene.counters.rejectedSteps, scene.counters.steps, largestPartRedone);
}

void warnOfRejections(const Scene& scene, Warnings& result) {
    const double part = partRedoneSoFar(scene);
    if (part == 0) return;
    const bool separately =
        scene.settings.traits().isOverdamped() && scene.fluid->getContents().groups.size() > 1;
    result[WarningCause::ManyRejections] =
        "the scheme redoes " + percent(part) + " of steps" + (separately ? " of a group" : "") +
        " (" + to_string(scene.counters.rejectedSteps) + " so far" + (separately ? " in all" : "") +
        "), above " + percent(largestPartRedone) +
        ": redoing steps so often biases averages near contact; take a smaller step, or let a "
        "repulsive force keep particles apart";
}

}  // namespace

bool stepsHaveWarnings(const Scene& scene, const set<WarningCause>& printed) {
    const auto isNew = [&](WarningCause cause) { return printed.count(cause) == 0; };
    if (isNew(WarningCause::WrongTemperature) && !scene.watch.getFinding().empty()) return true;
    const ContextFluid& fluid = scene.fluid;
    if (!fluid) return false;
    return (isNew(WarningCause::DriftFactorSpread) &&
            driftFactorSpread(fluid->getContents()) > driftFactorLimit) ||
           (isNew(WarningCause::ManyRejections) && partRedoneSoFar(scene) > 0) ||
           (isNew(WarningCause::StiffForces) &&
            !findStiffForces(fluid->getContents()).name.empty()) ||
           (isNew(WarningCause::LongDrive) &&
            !findLongDisplacements(fluid->getContents()).name.empty()) ||
           (isNew(WarningCause::ShortStep) && !findCrawling(fluid->getContents()).name.empty()) ||
           (isNew(WarningCause::DrivenSpin) && drivesSlowedSpins(fluid->getContents()));
}

Warnings findWarnings(const Scene& scene) {
    const CustomRigidHIIntegrator& integrator = scene.integrator;
    const BodySet& bodies = scene.bodies;
    Warnings result;
    const double kT = BOLTZ * integrator.getTemperature(), h = integrator.getStepSize();
    const SchemeTraits& traits = traitsOf(integrator.getScheme());
    const bool langevinA = traits.scheme == CustomRigidHIIntegrator::LangevinA;
    int unresolved = 0, firstUnresolved = -1;
    double worst = 0, largestGamma = integrator.getFriction(),
           largestRotational = integrator.getRotationalFriction();
    for (int b = 0; b < bodies.getNumBodies(); b++) {
        if (bodies.isHeld(b)) continue;
        double gamma, Gamma;
        integrator.getBodyFriction(b, gamma, Gamma);
        largestGamma = max(largestGamma, gamma);
        largestRotational = max(largestRotational, Gamma);
        if (bodies.rotor(b) != RotorKind::General) continue;
        const double* I = bodies.inertia(b).moments;
        const double turn = h * sqrt(kT * I[1] * I[2] / I[0]) * (1 / I[1] - 1 / I[2]);
        if (turn > resolutionLimit && unresolved++ == 0) firstUnresolved = b;
        worst = max(worst, turn);
    }
    if (traits.omitsDrift() && kT > 0 && scene.fluid &&
        FluidReport(scene.fluid->getContents()).hasStochasticDrift())
        result[WarningCause::OmittedDrift] =
            string(traits.name) +
            " omits the stochastic drift kT div N, which is not 0 here, and samples a wrong "
            "distribution; use RandomFiniteDifference, FixmanMidpoint, TrapezoidalSlip or "
            "DriftCorrectorRFD";
    if (traits.kind == SchemeKind::Thermostat && traits.hasMomenta)
        warnOfFastTurns(scene, h, kT, result);
    if (unresolved > 0 && traits.hasMomenta)
        result[WarningCause::UnresolvedRotation] =
            "the step of " + number(h) + " ps does not resolve the rotation of " +
            counted(unresolved, "body", "bodies") + ", the first of them body " +
            to_string(firstUnresolved) + " (h sqrt(kT I2 I3/I1) (1/I2 - 1/I3) is up to " +
            number(worst) + ", above " + number(resolutionLimit) +
            "): their temperature will be wrong; free rotation alone needs a step of " +
            shorter(h * resolutionLimit / worst) +
            " ps or less, and forces may need a far smaller one: watch "
            "computeMidStepTemperature()";
    if (langevinA &&
        (largestGamma > langevinAGammaLimit || largestRotational > langevinARotationalLimit))
        result[WarningCause::LargeFriction] =
            "LangevinA breaks down at large friction (gamma " + number(largestGamma) +
            "/ps, limit about " + number(langevinAGammaLimit) + "; Gamma " +
            number(largestRotational) + "/ps, limit about " + number(langevinARotationalLimit) +
            "); use LangevinB or LangevinC";
    if (langevinA) warnOfSpinUnderLangevinA(scene, h, kT, result);
    if (scene.fluid && traits.isOverdamped()) warnOfLeaps(scene, h, kT, result);
    if (traits.kind == SchemeKind::Thermostat && !traits.hasMomenta)
        warnOfTurns(scene, h, kT, result);
    if (scene.fluid && traits.kind == SchemeKind::FluidThermostat && kT > 0)
        warnOfRelaxation(scene, h, result);
    if (scene.fluid) {
        warnOfRejections(scene, result);
        warnOfMatricesByColumns(scene, kT, result);
    }
    const double spread = scene.fluid ? driftFactorSpread(scene.fluid->getContents()) : 0;
    if (traits.isOverdamped() && spread > driftFactorLimit)
        result[WarningCause::DriftFactorSpread] =
            "the drift factor nu of " + string(traits.name) + " fluctuates by " + number(spread) +
            " about 1, above " + number(driftFactorLimit) +
            ", so that the step is too large for the drift; take a smaller step, or "
            "RandomFiniteDifference or TrapezoidalSlip";
    addMismatches(scene, result);
    if (!scene.watch.getFinding().empty())
        result[WarningCause::WrongTemperature] = scene.watch.getFinding();
    return result;
}

Warnings findAllWarnings(const Scene& scene) {
    Warnings result = findWarnings(scene);
    addMismatchesOfMembers(scene, result);
    addMismatchesOfPlaces(scene, result);
    return result;
}

}  // namespace RigidHIPlugin

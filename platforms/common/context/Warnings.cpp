#include "context/Warnings.h"

#include <openmm/reference/SimTKOpenMMRealType.h>

#include <algorithm>
#include <cmath>

#include "context/Messages.h"
#include "context/Scene.h"
#include "openmmrigidhi/internal/Messages.h"

using namespace std;

namespace RigidHIPlugin {

namespace {

// The limit above which the schemes of Davidchack 2015 stop resolving a body's fast rotation
// (measured; docs/CONVENTIONS.md).
const double resolutionLimit = 0.1;
// Davidchack 2015, section VI: Langevin A breaks down above about these rates, 1/ps.
const double langevinAGammaLimit = 100, langevinARotationalLimit = 200;

}  // namespace

map<WarningCause, string> findWarnings(const Scene& scene) {
    const CustomRigidHIIntegrator& integrator = scene.integrator;
    const BodySet& bodies = scene.bodies;
    map<WarningCause, string> result;
    const double kT = BOLTZ * integrator.getTemperature(), h = integrator.getStepSize();
    const SchemeTraits& traits = traitsOf(integrator.getScheme());
    const bool langevinA = traits.scheme == CustomRigidHIIntegrator::LangevinA;
    int unresolved = 0, firstUnresolved = -1;
    double worst = 0, largestGamma = integrator.getFriction(),
           largestRotational = integrator.getRotationalFriction();
    for (int b = 0; b < bodies.getNumBodies(); b++) {
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
    if (traits.omitsDrift() && kT > 0 && scene.fluid && scene.fluid->hasStochasticDrift())
        result[WarningCause::OmittedDrift] =
            string(traits.name) +
            " omits the stochastic drift kT div N, which is not 0 here, and samples a wrong "
            "distribution; use RandomFiniteDifference, FixmanMidpoint, TrapezoidalSlip or "
            "DriftCorrectorRFD";
    if (unresolved > 0 && traits.hasMomenta)
        result[WarningCause::UnresolvedRotation] =
            "the step of " + number(h) + " ps does not resolve the rotation of " +
            counted(unresolved, "body", "bodies") + ", the first of them body " +
            to_string(firstUnresolved) + " (h sqrt(kT I2 I3/I1) (1/I2 - 1/I3) is up to " +
            number(worst) + ", above " + number(resolutionLimit) +
            "): their temperature will be wrong; free rotation alone needs a step of " +
            number(h * resolutionLimit / worst) +
            " ps or less, and forces may need a far smaller one: watch "
            "computeMidStepTemperature()";
    if (langevinA &&
        (largestGamma > langevinAGammaLimit || largestRotational > langevinARotationalLimit))
        result[WarningCause::LargeFriction] =
            "LangevinA breaks down at large friction (gamma " + number(largestGamma) +
            "/ps, limit about " + number(langevinAGammaLimit) + "; Gamma " +
            number(largestRotational) + "/ps, limit about " + number(langevinARotationalLimit) +
            "); use LangevinB or LangevinC";
    const double spread = scene.fluid ? scene.fluid->getDriftFactorSpread() : 0;
    if (traits.isOverdamped() && spread > driftFactorLimit)
        result[WarningCause::DriftFactorSpread] =
            "the drift factor nu of " + string(traits.name) + " fluctuates by " + number(spread) +
            " about 1, above " + number(driftFactorLimit) +
            ", so that the step is too large for the drift; take a smaller step, or "
            "RandomFiniteDifference or TrapezoidalSlip";
    if (!scene.watch.getFinding().empty())
        result[WarningCause::WrongTemperature] = scene.watch.getFinding();
    return result;
}

}  // namespace RigidHIPlugin

// The products with the particles' mobility in a step, for every scheme in a fluid, kind of model,
// kind of body and tolerance. Other tests show that these choices are accurate. This test states
// them and their reasons, so that nobody changes users' errors and times unawares.
//
// Left out is what no choice depends on: walls and periods, forces, driven flows, slowed spins,
// platforms and threads. Beside held bodies, spheres choose as multiblobs do, and with joints as
// spheres that have a drift. No model has both a random field and fast products. Where products
// iterate, all bodies are spheres.

#include <functional>
#include <memory>
#include <set>
#include <sstream>

#include "HydrodynamicSupport.h"
#include "RecordedProducts.h"
#include "TestSupport.h"
#include "openmmrigidhi/CustomBodyMotion.h"
#include "openmmrigidhi/SchemeTraits.h"
#include "rigid/ErrorBudget.h"
#include "schemes/OverdampedSchemes.h"

using namespace OpenMM;
using namespace RigidHIPlugin;
using namespace RigidHITest;
using namespace std;

namespace {

/** The products of two steps of a few bodies, and what getEffects() says about these steps. */
struct Steps {
    vector<string> asked;
    string difference;  // the finite-difference step; empty: none
    string products;    // empty: those of iterations are exact
};

enum Bodies { Spheres, Multiblobs, OwnTensors };

/** @param change  makes other settings */
Steps takeSteps(
    const Kind& kind, CustomRigidHIIntegrator::Scheme scheme, Bodies bodies, double tolerance,
    const function<void(FluidScene&)>& change = [](FluidScene&) {}) {
    RecordingPlatform recording(kind);
    FluidScene scene(1 / boltzmann, 1e-4);
    scene.fluid->setSolver(MobilityForce::MatrixFree);
    scene.fluid->setSolverTolerance(tolerance);
    scene.integrator.setScheme(scheme);
    for (int b = 0; b < 5; b++)
        scene.add(bodies == Spheres ? sphereKind(1 + 0.1 * b) : boomerangKind(),
                  Vec3(4 * (b % 2), 4 * (b / 2), 0.5 * b));
    if (bodies == OwnTensors) scene.fluid->setBodyMobility(2, rowsOf(tensorWithoutSymmetry(2)));
    change(scene);
    productsAskedFor.clear();
    scene.start(recording);
    auto effects = scene.integrator.getEffects();
    scene.integrator.step(2);
    const auto after = [&](const string& effect, const string& words) {
        const size_t place = effects[effect].find(words);
        return place == string::npos ? string() : effects[effect].substr(place + words.size());
    };
    Steps steps;
    steps.asked = productsAskedFor;
    istringstream(after("finite differences", "steps of ")) >> steps.difference;
    steps.products = after("hydrodynamics", "products in iterations ");
    EXPECT_EQ(scene.integrator.getEffects()["hydrodynamics"], effects["hydrodynamics"]);
    return steps;
}

/** The finite-difference step and the products of two steps. */
string choices(const Steps& steps) {
    string text;
    for (const string& product : steps.asked) text += " " + product;
    return steps.difference.empty() ? text.substr(1) : "step " + steps.difference + "," + text;
}

/** Whether getEffects() names the product that these steps made first. */
bool namesTheFirst(const Steps& steps) {
    const string products = steps.products.substr(0, steps.products.find(" for differences")),
                 first =
                     steps.asked[0] == "0" ? "over all pairs" : "with errors of " + steps.asked[0];
    return products.empty() ? steps.asked[0] == "0"
                            : (products + ",").find(first + ",") != string::npos;
}

/**
 * For each tolerance: the finite-difference step, if there is one, and the errors that products may
 * have.
 */
const string expected = R"(spheres, exact products
  LangevinHI
  EulerMaruyama
  FixmanMidpoint
    0.01 to 1e-08: 0
  RandomFiniteDifference
  TractionEulerMaruyama
  TrapezoidalSlip
    0.01: step 1e-05, 0 d0.0001
    0.0001: step 1e-05, 0 d1e-05
    5e-05: step 1e-05, 0 d5e-06
    1e-06: step 1e-05, 0 d1e-07
    1e-08: step 1e-05, 0 d1e-09
  DriftCorrectorFD
  DriftCorrectorRFD
    0.01 to 5e-05: step 0.01, 0
    1e-06 to 1e-08: step 1e-05, 0
spheres, products of single precision
  LangevinHI
    0.01 to 5e-05: 1e-06
    1e-06 to 1e-08: 0 1e-06
  EulerMaruyama
  FixmanMidpoint
    0.01 to 5e-05: 1e-06 0
    1e-06 to 1e-08: 0 1e-06
  RandomFiniteDifference
    0.01: step 1e-05, 1e-06 d0.0001
    0.0001: step 1e-05, 1e-06 d1e-05
    5e-05: step 1e-05, 1e-06 d5e-06
    1e-06: step 1e-05, 0 1e-06 d1e-07
    1e-08: step 1e-05, 0 1e-06 d1e-09
  TractionEulerMaruyama
  TrapezoidalSlip
    0.01: step 1e-05, 1e-06 0 d0.0001
    0.0001: step 1e-05, 1e-06 0 d1e-05
    5e-05: step 1e-05, 1e-06 0 d5e-06
    1e-06: step 1e-05, 0 1e-06 d1e-07
    1e-08: step 1e-05, 0 1e-06 d1e-09
  DriftCorrectorFD
  DriftCorrectorRFD
    0.01: step 0.01, 1e-06 0
    0.0001 to 5e-05: step 0.01, 0 1e-06
    1e-06 to 1e-08: step 1e-05, 0 1e-06
spheres, products of single precision on a device
  LangevinHI
    0.01 to 5e-05: 1e-06
    1e-06 to 1e-08: 0 1e-06
  EulerMaruyama
  FixmanMidpoint
    0.01: 1e-06 0.0001
    0.0001: 1e-06
    5e-05: 1e-06 0
    1e-06 to 1e-08: 0 1e-06
  RandomFiniteDifference
    0.01: step 1e-05, 1e-06 d0.0001
    0.0001: step 1e-05, 1e-06 d1e-05
    5e-05: step 1e-05, 1e-06 d5e-06
    1e-06: step 1e-05, 0 1e-06 d1e-07
    1e-08: step 1e-05, 0 1e-06 d1e-09
  TractionEulerMaruyama
    0.01: step 1e-05, 1e-06 0 d0.0001
    0.0001: step 1e-05, 1e-06 0 d1e-05
    5e-05: step 1e-05, 1e-06 0 d5e-06
    1e-06: step 1e-05, 0 1e-06 d1e-07
    1e-08: step 1e-05, 0 1e-06 d1e-09
  TrapezoidalSlip
    0.01: step 1e-05, 1e-06 0 d0.0001 0.0001
    0.0001: step 1e-05, 1e-06 0 d1e-05
    5e-05: step 1e-05, 1e-06 0 d5e-06
    1e-06: step 1e-05, 0 1e-06 d1e-07
    1e-08: step 1e-05, 0 1e-06 d1e-09
  DriftCorrectorFD
  DriftCorrectorRFD
    0.01: step 0.01, 1e-06 0.0001
    0.0001 to 5e-05: step 0.01, 0 1e-06
    1e-06 to 1e-08: step 1e-05, 0 1e-06
spheres, fast products
  LangevinHI
    0.01: 0.001
    0.0001: 1e-05
    5e-05: 5e-06
    1e-06 to 1e-08: 0 1e-06
  EulerMaruyama
  FixmanMidpoint
    0.01: 0.001 0.0001
    0.0001: 1e-05 1e-06
    5e-05: 5e-06 5e-07
    1e-06 to 1e-08: 0 1e-06
  RandomFiniteDifference
    0.01: step 1e-05, 0.001 d0.0001
    0.0001: step 1e-05, 1e-05 d1e-05
    5e-05: step 1e-05, 5e-06 d5e-06
    1e-06: step 1e-05, 0 1e-06 d1e-07
    1e-08: step 1e-05, 0 1e-06 d1e-09
  TractionEulerMaruyama
    0.01: step 1e-05, 0.001 0 d0.0001
    0.0001: step 1e-05, 1e-05 0 d1e-05
    5e-05: step 1e-05, 5e-06 0 d5e-06
    1e-06: step 1e-05, 0 1e-06 d1e-07
    1e-08: step 1e-05, 0 1e-06 d1e-09
  TrapezoidalSlip
    0.01: step 1e-05, 0.001 0 d0.0001 0.0001
    0.0001: step 1e-05, 1e-05 0 d1e-05 1e-06
    5e-05: step 1e-05, 5e-06 0 d5e-06 5e-07
    1e-06: step 1e-05, 0 1e-06 d1e-07
    1e-08: step 1e-05, 0 1e-06 d1e-09
  DriftCorrectorFD
  DriftCorrectorRFD
    0.01: step 0.01, 1e-06 0.001 0.0001
    0.0001: step 0.01, 0 1e-06 1e-05
    5e-05: step 0.01, 0 1e-06 5e-06 5e-07
    1e-06 to 1e-08: step 1e-05, 0 1e-06
spheres, fast products without drift
  LangevinHI
    0.01: 0.001
    0.0001: 1e-05
    5e-05: 5e-06
    1e-06 to 1e-08: 0 1e-06
  EulerMaruyama
  FixmanMidpoint
  RandomFiniteDifference
  TractionEulerMaruyama
  TrapezoidalSlip
  DriftCorrectorFD
  DriftCorrectorRFD
    0.01: 0.001 0.0001
    0.0001: 1e-05 1e-06
    5e-05: 5e-06 5e-07
    1e-06 to 1e-08: 0 1e-06
spheres, a random flow
  LangevinHI
    0.01 to 5e-05: 1e-06
    1e-06 to 1e-08: 0 1e-06
  EulerMaruyama
  DriftCorrectorFD
  DriftCorrectorRFD
    0.01 to 1e-08: 0
  FixmanMidpoint
    0.01 to 5e-05: 1e-06 0
    1e-06 to 1e-08: 0 1e-06
  RandomFiniteDifference
    0.01: step 1e-05, d0.0001
    0.0001: step 1e-05, d1e-05
    5e-05: step 1e-05, d5e-06
    1e-06: step 1e-05, d1e-07
    1e-08: step 1e-05, d1e-09
  TractionEulerMaruyama
  TrapezoidalSlip
    0.01: step 1e-05, 0 d0.0001
    0.0001: step 1e-05, 0 d1e-05
    5e-05: step 1e-05, 0 d5e-06
    1e-06: step 1e-05, 0 d1e-07
    1e-08: step 1e-05, 0 d1e-09
spheres, random velocities
  LangevinHI
    0.01 to 5e-05: 1e-06
    1e-06 to 1e-08: 0 1e-06
  EulerMaruyama
    0.01 to 1e-08: 0
  FixmanMidpoint
    0.01 to 5e-05: 1e-06 0
    1e-06 to 1e-08: 0 1e-06
  RandomFiniteDifference
    0.01: step 1e-05, d0.0001
    0.0001: step 1e-05, d1e-05
    5e-05: step 1e-05, d5e-06
    1e-06: step 1e-05, d1e-07
    1e-08: step 1e-05, d1e-09
  TractionEulerMaruyama
  TrapezoidalSlip
    0.01: step 1e-05, 0 d0.0001
    0.0001: step 1e-05, 0 d1e-05
    5e-05: step 1e-05, 0 d5e-06
    1e-06: step 1e-05, 0 d1e-07
    1e-08: step 1e-05, 0 d1e-09
  DriftCorrectorFD
  DriftCorrectorRFD
    0.01 to 1e-06: step 0.01, 0
    1e-08: step 0.00215443, 0
spheres, products that iterate
  EulerMaruyama
  FixmanMidpoint
    0.01: 1e-06 s0.01 0
    0.0001: 1e-06 s0.0001 0
    5e-05: 1e-06 s5e-05 0
    1e-06: 0 1e-06 s1e-06
    1e-08: 0 1e-06 s1e-08
  RandomFiniteDifference
    0.01 to 5e-05: step 1e-05, 1e-06 s0 0
    1e-06 to 1e-08: step 1e-05, 0 1e-06 s0
  TractionEulerMaruyama
  TrapezoidalSlip
    0.01: step 1e-05, 1e-06 s0.01 0 d0.0001
    0.0001: step 1e-05, 1e-06 s0.0001 0 d1e-05
    5e-05: step 1e-05, 1e-06 s5e-05 0 d5e-06
    1e-06: step 1e-05, 0 1e-06 s1e-06 d1e-07
    1e-08: step 1e-05, 0 1e-06 s1e-08 d1e-09
spheres, slips of parts
  EulerMaruyama
    0.01: s0.01 0
    0.0001: s0.0001 0
    5e-05: s5e-05 0
    1e-06: s1e-06 0
    1e-08: s1e-08 0
  FixmanMidpoint
    0.01: 1e-06 s0.01 0
    0.0001: 1e-06 s0.0001 0
    5e-05: 1e-06 s5e-05 0
    1e-06: 0 1e-06 s1e-06
    1e-08: 0 1e-06 s1e-08
  RandomFiniteDifference
    0.01 to 1e-08: step 1e-05, s0 0
  TractionEulerMaruyama
  TrapezoidalSlip
    0.01: step 1e-05, s0.01 0 d0.0001
    0.0001: step 1e-05, s0.0001 0 d1e-05
    5e-05: step 1e-05, s5e-05 0 d5e-06
    1e-06: step 1e-05, s1e-06 0 d1e-07
    1e-08: step 1e-05, s1e-08 0 d1e-09
multiblobs, exact products
  LangevinHI
  EulerMaruyama
  FixmanMidpoint
    0.01 to 1e-08: 0
  RandomFiniteDifference
    0.01 to 1e-06: step 0.01, 0
    1e-08: step 0.00215443, 0
  TractionEulerMaruyama
  TrapezoidalSlip
    0.01: step 1e-05, 0 d0.0001
    0.0001: step 1e-05, 0 d1e-05
    5e-05: step 1e-05, 0 d5e-06
    1e-06: step 1e-05, 0 d1e-07
    1e-08: step 1e-05, 0 d1e-09
  DriftCorrectorFD
  DriftCorrectorRFD
    0.01 to 5e-05: step 0.01, 0
    1e-06 to 1e-08: step 1e-05, 0
multiblobs, products of single precision
  LangevinHI
    0.01: 1e-06
    0.0001 to 1e-08: 1e-06 0
  EulerMaruyama
  FixmanMidpoint
    0.01 to 5e-05: 1e-06
    1e-06 to 1e-08: 0 1e-06
  RandomFiniteDifference
    0.01: step 0.01, 1e-06
    0.0001 to 1e-06: step 0.01, 0 1e-06
    1e-08: step 0.00215443, 0
  TractionEulerMaruyama
  TrapezoidalSlip
    0.01: step 1e-05, 1e-06 d0.0001
    0.0001: step 1e-05, 1e-06 d1e-05
    5e-05: step 1e-05, 1e-06 d5e-06
    1e-06: step 1e-05, 0 1e-06 d1e-07
    1e-08: step 1e-05, 0 1e-06 d1e-09
  DriftCorrectorFD
  DriftCorrectorRFD
    0.01: step 0.01, 1e-06
    0.0001 to 5e-05: step 0.01, 0 1e-06
    1e-06 to 1e-08: step 1e-05, 0 1e-06
multiblobs, products of single precision on a device
  as multiblobs, products of single precision
multiblobs, fast products
  LangevinHI
    0.01: 1e-05
    0.0001 to 1e-08: 1e-06 0
  EulerMaruyama
  FixmanMidpoint
    0.01: 0.00041 0.0002
    0.0001: 4.1e-06 2e-06
    5e-05: 2.1e-06 1e-06
    1e-06 to 1e-08: 0 1e-06
  RandomFiniteDifference
    0.01: step 0.01, 1e-06
    0.0001 to 1e-06: step 0.01, 0 1e-06
    1e-08: step 0.00215443, 0
  TractionEulerMaruyama
  TrapezoidalSlip
    0.01: step 1e-05, 0.00041 0.0002 d0.0001
    0.0001: step 1e-05, 4.1e-06 2e-06 d1e-05
    5e-05: step 1e-05, 2.1e-06 1e-06 d5e-06
    1e-06: step 1e-05, 0 1e-06 d1e-07
    1e-08: step 1e-05, 0 1e-06 d1e-09
  DriftCorrectorFD
  DriftCorrectorRFD
    0.01: step 0.01, 1e-06 0.00041 0.0002
    0.0001: step 0.01, 0 1e-06 4.1e-06 2e-06
    5e-05: step 0.01, 0 1e-06 2.1e-06
    1e-06 to 1e-08: step 1e-05, 0 1e-06
multiblobs, a random flow
  LangevinHI
    0.01: 1e-06
    0.0001 to 1e-08: 1e-06 0
  EulerMaruyama
  DriftCorrectorFD
  DriftCorrectorRFD
    0.01 to 5e-05: 1e-06
    1e-06 to 1e-08: 1e-06 0
  FixmanMidpoint
    0.01 to 5e-05: 1e-06
    1e-06 to 1e-08: 0 1e-06
  RandomFiniteDifference
    0.01: step 0.01, 1e-06
    0.0001 to 1e-06: step 0.01, 1e-06 0
    1e-08: step 0.00215443, 0
  TractionEulerMaruyama
  TrapezoidalSlip
    0.01: step 1e-05, 1e-06 d0.0001
    0.0001: step 1e-05, 1e-06 d1e-05
    5e-05: step 1e-05, 1e-06 d5e-06
    1e-06: step 1e-05, 1e-06 0 d1e-07
    1e-08: step 1e-05, 1e-06 0 d1e-09
multiblobs, random velocities
  LangevinHI
    0.01: 1e-06
    0.0001 to 1e-08: 1e-06 0
  EulerMaruyama
    0.01 to 5e-05: 1e-06
    1e-06 to 1e-08: 1e-06 0
  FixmanMidpoint
    0.01 to 5e-05: 1e-06
    1e-06 to 1e-08: 0 1e-06
  RandomFiniteDifference
    0.01: step 0.01, 1e-06
    0.0001 to 1e-06: step 0.01, 1e-06 0
    1e-08: step 0.00215443, 0
  TractionEulerMaruyama
  TrapezoidalSlip
    0.01: step 1e-05, 1e-06 d0.0001
    0.0001: step 1e-05, 1e-06 d1e-05
    5e-05: step 1e-05, 1e-06 d5e-06
    1e-06: step 1e-05, 1e-06 0 d1e-07
    1e-08: step 1e-05, 1e-06 0 d1e-09
  DriftCorrectorFD
  DriftCorrectorRFD
    0.01 to 5e-05: step 0.01, 1e-06
    1e-06: step 0.01, 1e-06 0
    1e-08: step 0.00215443, 1e-06 0
multiblobs with own tensors, fast products
  LangevinHI
    0.01: 1e-05
    0.0001 to 1e-08: 1e-06 0
  EulerMaruyama
  FixmanMidpoint
    0.01: 0.00041 0.0002
    0.0001: 4.1e-06 2e-06
    5e-05: 2.1e-06 1e-06
    1e-06 to 1e-08: 0 1e-06
  RandomFiniteDifference
  TractionEulerMaruyama
    0.01: step 0.01, 1e-06
    0.0001 to 1e-06: step 0.01, 0 1e-06
    1e-08: step 0.00215443, 0
  TrapezoidalSlip
    0.01: step 0.01, 1e-06 0.0002
    0.0001: step 0.01, 0 1e-06 2e-06
    5e-05 to 1e-06: step 0.01, 0 1e-06
    1e-08: step 0.00215443, 0 1e-06
  DriftCorrectorFD
  DriftCorrectorRFD
    0.01: step 0.01, 1e-06 0.00041 0.0002
    0.0001: step 0.01, 0 1e-06 4.1e-06 2e-06
    5e-05: step 0.01, 0 1e-06 2.1e-06
    1e-06: step 0.01, 0 1e-06
    1e-08: step 0.00215443, 0 1e-06
)";

/** Bodies in a model, with all schemes and tolerances. */
struct Case {
    Bodies bodies;
    Kind kind;
    string name() const {
        const char* const names[] = {"spheres, ", "multiblobs, ", "multiblobs with own tensors, "};
        return string(names[bodies]) + kind.name;
    }
    /** GroupBuilder refuses other schemes where products are iterations. */
    bool takes(const SchemeTraits& scheme) const {
        return scheme.takesIterations() || kind.products == Kind::Direct;
    }
};

/** Why a step has these products. The rules follow from the schemes and from the errors alone. */
class Reasons {
public:
    Reasons(const Case& bodiesInModel, const SchemeTraits& scheme, double tolerance)
        : kind(bodiesInModel.kind), bodies(bodiesInModel.bodies), scheme(scheme),
          tolerance(tolerance) {
        results = scheme.differenced;
        // The drift of spheres is 0 in a model without drift. Flows know their divergence.
        if (bodies == Spheres && kind.isDivergenceFree) results = Differenced::Nothing;
        divergenceIsKnown = results == Differenced::Roots && kind.noise == Kind::LocalField;
        // Products with M are no iterations. Where bodies have tensors of their own, no M exists,
        // and products are solves. Solves of spheres are products.
        iterate = (results == Differenced::Products && bodies == OwnTensors) ||
                  (results == Differenced::Solves && bodies != Spheres) ||
                  (results == Differenced::Roots && !divergenceIsKnown);
        // Roots at two places follow one course, if nothing iterates within them. Fields whose
        // flow depends on the place have no course.
        follow = iterate && results == Differenced::Roots && bodies != OwnTensors &&
                 kind.noise == Kind::Roots;
    }

    void check(const Steps& steps) const {
        checkStep(steps.difference);
        vector<double> values;
        bool areDifferenced = false;
        for (const string& product : steps.asked) {
            const double error = stod(product.substr(isdigit(product[0]) ? 0 : 1));
            if (product[0] == 'd') {
                areDifferenced = true;
                // A drift has a tenth of the tolerance, and at least four digits.
                EXPECT_NEAR(error, min(1e-4, 0.1 * tolerance), 1e-3 * error);
            } else if (product[0] == 's') {
                // Differences of solves of spheres have steps of 1e-5, so solves are exact.
                EXPECT_EQ(error, results == Differenced::Solves ? 0 : tolerance);
            } else {
                checkValue(error);
                values.push_back(error);
            }
        }
        // Schemes take differences of products with M where these are no iterations.
        const bool ofProducts =
            !iterate && (results == Differenced::Products ||
                         (results == Differenced::Solves && kind.products == Kind::Direct));
        EXPECT_EQ(areDifferenced, ofProducts);
        if (iterate) checkDifferencedIterations(values);
    }

private:
    /** Rounding to 1e-16 and the error of the difference have their balance at 1e-5. */
    void checkStep(const string& text) const {
        if (results == Differenced::Nothing || divergenceIsKnown) {
            EXPECT_EQ(text, "");
            return;
        }
        double step = 1e-5;
        // An error t of results and the step's own error of step^2 have theirs at t^(1/3). Errors
        // of one course cancel, so such results need long steps for single precision only.
        if (iterate && !follow) step = min(1e-2, cbrt(tolerance));
        if (follow && tolerance >= Accuracy::leastToleranceOfSinglePrecision) step = 1e-2;
        EXPECT_NEAR(stod(text), step, 1e-5 * step);
    }
    void checkValue(double error) const {
        if (error == 0) return;
        const double single = Accuracy::errorOfSinglePrecision, digits = 1e-2;
        const bool isSingle = abs(error - single) <= digits * single;
        // A single product that is a solve has a hundredth of the tolerance.
        const bool isSolve = bodies == Spheres && abs(error - 0.01 * tolerance) <= digits * error;
        if (isSingle && kind.hasSingle) return;
        EXPECT_TRUE(kind.hasFast || (kind.hasFastSingle && isSolve && error >= single));
        EXPECT_TRUE(isSolve || error > single);
        EXPECT_LE(error, min(1e-3, (0.1 + digits) * tolerance));
    }
    /** Larger errors than those of single precision jump from place to place. */
    void checkDifferencedIterations(const vector<double>& values) const {
        const double single = 1.01 * Accuracy::errorOfSinglePrecision;
        // Iterations have a tenth of the tolerance, or what roots of one course need.
        const double part = follow ? max(0.1, min(1.0, 1e-4 / (100 * tolerance))) : 0.1;
        const bool small = tolerance * part < Accuracy::leastToleranceOfSinglePrecision;
        EXPECT_LE(values[0], single);
        // Steps begin with roots, and roots begin exactly where the errors of the first products
        // could be larger than their own.
        if (small && kind.noise == Kind::Roots) {
            EXPECT_EQ(values[0], 0);
        }
        // The only stage of a scheme takes differences: nothing follows.
        if (overdampedScheme(scheme.scheme).numStages() > 1) return;
        for (double error : values) EXPECT_LE(error, single);
    }

    const Kind& kind;
    const Bodies bodies;
    const SchemeTraits& scheme;
    const double tolerance;
    bool divergenceIsKnown, iterate, follow;
    Differenced results;
};

const Kind
    exact = {"exact products", false, false, false},
    single = {"products of single precision", true, false, false},
    device = {"products of single precision on a device", true, false, false, true},
    fast = {"fast products", true, true, false},
    withoutDrift = {"fast products without drift", true, true, true},
    localField = {"a random flow", true, false, false, false, Kind::LocalField},
    otherField = {"random velocities", true, false, false, false, Kind::OtherField},
    iterating = {"products that iterate", true, false, false, false, Kind::Roots, Kind::Iterate},
    inParts = {"slips of parts", true, false, false, false, Kind::OtherField, Kind::IterateInParts};

/** Models with random fields have no fast products. */
const Case cases[] = {{Spheres, exact},      {Spheres, single},        {Spheres, device},
                      {Spheres, fast},       {Spheres, withoutDrift},  {Spheres, localField},
                      {Spheres, otherField}, {Spheres, iterating},     {Spheres, inParts},
                      {Multiblobs, exact},   {Multiblobs, single},     {Multiblobs, device},
                      {Multiblobs, fast},    {Multiblobs, localField}, {Multiblobs, otherField},
                      {OwnTensors, fast}};
const double tolerances[] = {1e-2, 1e-4, 5e-5, 1e-6, 1e-8};

/** The choices at the tolerances; tolerances with the same choices are in one line. */
string linesOf(const vector<string>& choices) {
    ostringstream text;
    for (size_t first = 0, last; first < choices.size(); first = last + 1) {
        for (last = first; last + 1 < choices.size() && choices[last + 1] == choices[first];)
            last++;
        text << "    " << tolerances[first];
        if (last > first) text << " to " << tolerances[last];
        text << ": " << choices[first] << "\n";
    }
    return text.str();
}

}  // namespace

TEST(ErrorBudget, EverySchemeHasTheseProducts) {
    ostringstream found;
    vector<pair<string, string>> texts;  // of cases, by name
    testing::internal::CaptureStderr();  // warnings that EulerMaruyama omits the drift
    for (const Case& one : cases) {
        vector<pair<string, string>> lines;  // choices, and schemes with them
        for (const SchemeTraits& scheme : schemeTable) {
            if (!scheme.needsFluid() || !one.takes(scheme)) continue;
            vector<string> found;
            for (double tolerance : tolerances) {
                SCOPED_TRACE(one.name() + ", " + scheme.name + ", " + to_string(tolerance));
                const Steps steps = takeSteps(one.kind, scheme.scheme, one.bodies, tolerance);
                found.push_back(choices(steps));
                Reasons(one, scheme, tolerance).check(steps);
                // Models with random fields have nothing to say about products.
                if (one.kind.noise != Kind::Roots) continue;
                EXPECT_TRUE(namesTheFirst(steps)) << "the text has: " << steps.products;
            }
            const string text = linesOf(found);
            const auto known = find_if(lines.begin(), lines.end(),
                                       [&](const auto& other) { return other.first == text; });
            if (known == lines.end())
                lines.push_back({text, scheme.name});
            else
                known->second += string("\n  ") + scheme.name;
        }
        string text;
        for (const auto& group : lines) text += "  " + group.second + "\n" + group.first;
        const auto same = find_if(texts.begin(), texts.end(),
                                  [&](const auto& other) { return other.second == text; });
        found << one.name() << "\n" << (same == texts.end() ? text : "  as " + same->first + "\n");
        texts.push_back({one.name(), text});
    }
    testing::internal::GetCapturedStderr();
    EXPECT_EQ(found.str(), expected);
}

/** Matrices have no errors of iterations, so that no product may have an error. */
TEST(ErrorBudget, MatricesAreMadeExactly) {
    testing::internal::CaptureStderr();
    for (const Case& one : cases)
        for (const SchemeTraits& scheme : schemeTable)
            // Models with slips of parts are for solver MatrixFree alone.
            if (scheme.needsFluid() && one.kind.products != Kind::IterateInParts) {
                SCOPED_TRACE(one.name() + ", " + scheme.name);
                const Steps steps = takeSteps(
                    one.kind, scheme.scheme, one.bodies, 1e-2,
                    [](FluidScene& scene) { scene.fluid->setSolver(MobilityForce::Dense); });
                EXPECT_EQ(steps.asked, vector<string>{"0"});
                EXPECT_EQ(steps.products, "");
                EXPECT_TRUE(steps.difference.empty() || steps.difference == "1e-05");
            }
    testing::internal::GetCapturedStderr();
}

/** Each group of bodies has its own budget: that which it has in a System of its own. */
TEST(ErrorBudget, GroupsHaveTheirOwn) {
    testing::internal::CaptureStderr();
    for (const SchemeTraits& scheme : schemeTable)
        for (double tolerance : {1e-2, 1e-6}) {
            if (!scheme.needsFluid()) continue;
            SCOPED_TRACE(string(scheme.name) + ", " + to_string(tolerance));
            const Steps both =
                takeSteps(fast, scheme.scheme, Spheres, tolerance, [](FluidScene& scene) {
                    for (int b = 0; b < 5; b++)
                        scene.add(boomerangKind(), Vec3(20 + 4 * (b % 2), 4 * (b / 2), 0.5 * b));
                    scene.fluid->setGroups({0, 0, 0, 0, 0, 1, 1, 1, 1, 1});
                });
            set<string> expected;
            string difference;
            for (Bodies bodies : {Spheres, Multiblobs}) {
                const Steps steps = takeSteps(fast, scheme.scheme, bodies, tolerance);
                expected.insert(steps.asked.begin(), steps.asked.end());
                if (steps.difference.empty()) continue;
                if (difference.empty() || stod(steps.difference) < stod(difference))
                    difference = steps.difference;
            }
            EXPECT_EQ(set<string>(both.asked.begin(), both.asked.end()), expected);
            EXPECT_EQ(both.difference, difference);
        }
    testing::internal::GetCapturedStderr();
}

/**
 * A random flow knows its divergence, but not where components of bodies are fixed along axes that
 * turn with them. Iterations then have their part of the tolerance, as with other random fields.
 */
TEST(ErrorBudget, FlowsNeedDifferencesWhereAxesTurn) {
    const auto steps = [](const Kind& kind, CustomBodyMotion::Frame frame) {
        return takeSteps(kind, CustomRigidHIIntegrator::DriftCorrectorRFD, Multiblobs, 1e-4,
                         [=](FluidScene& scene) {
                             auto* motion = new CustomBodyMotion("0", "", "", "", "", "");
                             motion->setFrame(frame);
                             motion->addBody(0, {});
                             scene.system.addForce(motion);
                         });
    };
    const Steps lab = steps(localField, CustomBodyMotion::Lab),
                turning = steps(localField, CustomBodyMotion::Body),
                other = steps(otherField, CustomBodyMotion::Body);
    EXPECT_EQ(lab.difference, "");
    EXPECT_EQ(turning.difference, "0.01");
    EXPECT_EQ(choices(turning), choices(other));
}

/** describeEffects() reads the budget of the step: the tolerance of differences, and their step. */
TEST(ErrorBudget, EffectsNameTheProductsOfTheStep) {
    const auto text = [](CustomRigidHIIntegrator::Scheme scheme, Bodies bodies, double tolerance,
                         double difference = 0) {
        const auto steps = takeSteps(fast, scheme, bodies, tolerance, [=](FluidScene& scene) {
            scene.integrator.setFiniteDifferenceStep(difference);
        });
        return steps.products;
    };
    const auto corrector = CustomRigidHIIntegrator::DriftCorrectorRFD;
    // Differences take a tenth of the tolerance, and begin exactly at 1e-4.
    EXPECT_EQ(text(corrector, Multiblobs, 1e-3),
              "with errors of 1e-06 for differences, then of roots with errors of 4.1e-05, of "
              "solves with errors of 2e-05");
    EXPECT_EQ(text(corrector, Multiblobs, 1e-4),
              "of roots over all pairs, of solves with errors of 1e-06 for differences, then of "
              "roots with errors of 4.1e-06, of solves with errors of 2e-06");
    // A short difference needs exact products.
    EXPECT_EQ(text(corrector, Multiblobs, 1e-3, 1e-3),
              "over all pairs for differences, then of roots with errors of 4.1e-05, of solves "
              "with errors of 2e-05");
    EXPECT_EQ(text(corrector, Spheres, 1e-3, 1e-3),
              "over all pairs for differences, then with errors of 0.0001");
    EXPECT_EQ(text(CustomRigidHIIntegrator::EulerMaruyama, Spheres, 1e-3), "with errors of 0.0001");
    // The only iterations of multiblobs with momenta are solves to a part of the tolerance.
    EXPECT_EQ(text(CustomRigidHIIntegrator::LangevinHI, Multiblobs, 1e-2), "with errors of 1e-05");
    EXPECT_EQ(text(CustomRigidHIIntegrator::LangevinHI, Spheres, 1e-2), "with errors of 0.001");
}

/** Default steps of differences, and the requirements of such differences on iterations. */
TEST(ErrorBudget, DifferencesTakeTheirPartOfTheTolerance) {
    const Differencing nothing, products = {Differenced::Products, false, false},
                                solves = {Differenced::Solves, true, false},
                                roots = {Differenced::Roots, true, true};
    const struct {
        Differencing of;
        double tolerance, step, part, share;
        bool exact, coarse, exactSolves, differencedSolves;
    } rows[] = {
        // Without iterations there is only rounding.
        {nothing, 1e-3, 1e-5, 1, 0, false, true, false, false},
        {products, 1e-3, 1e-5, 1, 0, false, true, true, false},
        // The error of t/step is balanced with that of step^2, up to the longest step.
        {solves, 1e-3, 1e-2, 0.1, 0, false, false, true, true},
        {solves, 1e-9, 1e-3, 0.1, 0, true, false, true, true},
        {solves, 1e-15, 1e-5, 0.1, 0, true, false, true, true},
        // Roots of one course: a hundred tolerances of the iteration are to be 1e-4.
        {roots, 1e-3, 1e-2, 0.1, 1e-4, false, false, true, false},
        {roots, 1e-4, 1e-2, 0.1, 1e-5, false, false, true, false},
        {roots, 2e-6, 1e-5, 0.5, 1e-9, true, false, true, false},
        {roots, 1e-8, 1e-5, 1, 1e-11, true, false, true, false},
    };
    for (const auto& row : rows) {
        SCOPED_TRACE(row.tolerance);
        const double step = ErrorBudget::differenceStep(row.tolerance, row.of);
        EXPECT_NEAR(step, row.step, 1e-12 * row.step);
        const ErrorBudget::Needs needed =
            ErrorBudget::ofDifferencing(row.tolerance, row.of, row.step).getNeeds();
        EXPECT_NEAR(needed.partOfTolerance, row.part, 1e-12);
        EXPECT_NEAR(needed.shareOfInexact, row.share, 1e-12 * row.share);
        EXPECT_EQ(needed.exactProducts, row.exact);
        EXPECT_EQ(needed.largeErrors, row.coarse);
        EXPECT_EQ(needed.exactSolves, row.exactSolves);
        EXPECT_EQ(needed.differencedSolves, row.differencedSolves);
    }
}

TEST(ErrorBudget, ProductsBecomeFinerOneAfterTheOther) {
    HydrodynamicParticles none;
    const auto fastModel = recordingModel(fast, none, 1);
    const MobilityModel& model = *fastModel;
    const auto errorsOf = [&](const ErrorBudget& budget, double amplification) {
        vector<double> errors;
        for (const auto& product : budget.inRoots(model, amplification))
            errors.push_back(product.error);
        return errors;
    };
    EXPECT_EQ(errorsOf(ErrorBudget(1e-3), 1), (vector<double>{1e-4, 1e-5, 1e-6}));
    EXPECT_EQ(errorsOf(ErrorBudget(1e-1), 1), (vector<double>{1e-3, 1e-3, 1e-6}));
    EXPECT_EQ(errorsOf(ErrorBudget(1e-3), 20), (vector<double>{5e-6, 1e-6}));
    EXPECT_EQ(errorsOf(ErrorBudget(1e-8), 1), (vector<double>{1e-6}));
    EXPECT_EQ(errorsOf(ErrorBudget::beforeSteps(1e-3), 1), (vector<double>{1e-6}));
    // From this tolerance on, single precision is right from the first product on.
    EXPECT_TRUE(ErrorBudget(5e-5).inRoots(model, 1).back().atOnce);
    EXPECT_FALSE(ErrorBudget(4.9e-5).inRoots(model, 1).back().atOnce);
    // The longest difference leaves single precision, shorter ones a share of it.
    ErrorBudget::Needs needed;
    needed.largeErrors = false;
    EXPECT_EQ(errorsOf(ErrorBudget(1e-3, needed), 1), (vector<double>{1e-6}));
    EXPECT_EQ(ErrorBudget(1e-3, needed).inSolves(model, 1e-4), 1e-6);
    needed.exactProducts = true;
    EXPECT_TRUE(errorsOf(ErrorBudget(1e-3, needed), 1).empty());
    EXPECT_EQ(ErrorBudget(1e-3, needed).inSolves(model, 1e-4), 0);
    needed.shareOfInexact = 1e-7;
    EXPECT_EQ(errorsOf(ErrorBudget(1e-3, needed), 1), (vector<double>{1e-6}));
    // Solves take what is useful to them, between both limits.
    EXPECT_EQ(ErrorBudget(1e-3).inSolves(model, 1e-2), 1e-3);
    EXPECT_EQ(ErrorBudget(1e-3).inSolves(model, 1e-5), 1e-5);
    EXPECT_EQ(ErrorBudget(1e-3).inSolves(model, 1e-8), 1e-6);
}

TEST(ErrorBudget, SolvesTryFinerProductsThatReduceResiduals) {
    using Errors = vector<double>;
    EXPECT_EQ(ErrorBudget::attemptsOfSolve(1e-4, 10, true), (Errors{1e-4, 1e-6, 0}));
    EXPECT_EQ(ErrorBudget::attemptsOfSolve(1e-6, 10, true), (Errors{1e-6, 0}));
    EXPECT_EQ(ErrorBudget::attemptsOfSolve(0, 10, true), (Errors{0}));
    EXPECT_EQ(ErrorBudget::attemptsOfSolve(1e-4, 10, false), (Errors{0}));
    // Badly conditioned bodies magnify errors: these products would not reduce the residual.
    EXPECT_EQ(ErrorBudget::attemptsOfSolve(1e-4, 1e4, true), (Errors{1e-6, 0}));
    EXPECT_EQ(ErrorBudget::attemptsOfSolve(1e-4, 1e6, true), (Errors{0}));
    // A stage of single precision reduces residuals to 5e-5, unless bodies magnify errors more.
    EXPECT_NEAR(ErrorBudget::reductionBy(1e-6, 10), 5e-5, 1e-15);
    EXPECT_NEAR(ErrorBudget::reductionBy(1e-6, 1e3), 1e-3, 1e-15);
}

TEST(ErrorBudget, OneProductIsOfSinglePrecisionWhereADeviceMakesIt) {
    HydrodynamicParticles none;
    const auto hostModel = recordingModel(single, none, 1),
               deviceModel = recordingModel(device, none, 1);
    const MobilityModel &onHost = *hostModel, &onDevice = *deviceModel;
    ErrorBudget::Needs needed;
    const auto error = [&](double tolerance, const MobilityModel& model) {
        return ErrorBudget(tolerance, needed).ofProductsAsSolves(model).error;
    };
    needed.exactSolves = false;
    EXPECT_EQ(error(1e-2, onDevice), 1e-4);
    EXPECT_EQ(error(1e-2, onHost), 0);
    EXPECT_EQ(error(9e-5, onDevice), 0);
    needed.exactSolves = true;
    EXPECT_EQ(error(1e-2, onDevice), 0);
    EXPECT_TRUE(ErrorBudget::savesTime(onDevice, 1e-6));
    EXPECT_FALSE(ErrorBudget::savesTime(onDevice, 9e-7));
    EXPECT_FALSE(ErrorBudget::savesTime(onHost, 1e-2));
    // Iterations ask for no larger errors, which would take as long.
    EXPECT_EQ(ErrorBudget(1e-3).inRoots(onDevice, 1).size(), 1u);
    EXPECT_EQ(ErrorBudget(1e-3).inSolves(onDevice, 1e-2), Accuracy::errorOfSinglePrecision);
}

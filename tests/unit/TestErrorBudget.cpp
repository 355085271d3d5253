// The products with the particles' mobility in a step, for every scheme in a fluid, kind of model,
// kind of body and tolerance. Other tests show that these choices are accurate. This test states
// them, so that nobody changes users' errors and times unawares.

#include <openmm/KernelFactory.h>
#include <openmm/reference/ReferencePlatform.h>

#include <functional>
#include <memory>
#include <set>
#include <sstream>

#include "HydrodynamicSupport.h"
#include "TestSupport.h"
#include "context/ReferenceArrays.h"
#include "host/ScalarLoops.h"
#include "kernel/RigidBodyKernel.h"
#include "mobility/models/rotneprager/RotnePragerYamakawa.h"
#include "openmmrigidhi/SchemeTraits.h"
#include "rigid/ErrorBudget.h"

using namespace OpenMM;
using namespace RigidHIPlugin;
using namespace RigidHITest;
using namespace std;

namespace {

/** What a model says about its products and drifts. */
struct Kind {
    const char* name;
    bool hasSingle, hasFast, isDivergenceFree;
    bool hasFastSingle = false;
};

/**
 * The errors that products were allowed, each once, in the order in which they were first needed. d
 * stands before the error of a difference.
 */
vector<string> asked;

void record(const char* kind, double error) {
    ostringstream text;
    text.precision(2);
    text << kind << error;
    if (find(asked.begin(), asked.end(), text.str()) == asked.end()) asked.push_back(text.str());
}

/** Exact products, whatever error they may have. */
class RecordingPlace : public MobilityAt {
public:
    explicit RecordingPlace(const MobilityModel& model)
        : MobilityAt(model), plain(model.getParticles(), model.getViscosity()) {}
    void multiply(const MatrixXd& forces, MatrixXd& velocities, const Accuracy& accuracy) override {
        record(accuracy.purpose == Accuracy::Difference ? "d" : "", accuracy.error);
        at->multiply(forces, velocities);
    }

protected:
    void moveTo(const Placement& placement, bool) override { plain.place(at, placement); }

private:
    const RotnePragerYamakawa plain;
    unique_ptr<MobilityAt> at;
};

class RecordingModel : public MobilityModel {
public:
    RecordingModel(const Kind& kind, const HydrodynamicParticles& particles, double viscosity)
        : MobilityModel(particles, viscosity, traitsOf(kind)), kind(kind) {}
    bool hasFastProducts(double error) const override { return kind.hasFast && error >= 1e-7; }
    string describeFastProducts(double error) const override {
        ostringstream text;
        text.precision(2);
        text << "with errors of " << error;
        return error > 0 ? text.str() : string();
    }

protected:
    unique_ptr<MobilityAt> makePlace() const override { return make_unique<RecordingPlace>(*this); }

private:
    const Kind kind;

    static MobilityTraits traitsOf(const Kind& kind) {
        MobilityTraits traits(kind.name);
        traits.isIsotropic = true;
        traits.isDivergenceFree = kind.isDivergenceFree;
        traits.hasSinglePrecision = kind.hasSingle;
        traits.hasFastSinglePrecision = kind.hasFastSingle;
        return traits;
    }
};

class RecordingLoops : public ScalarLoops {
public:
    explicit RecordingLoops(const Kind& kind) : kind(kind) {}
    unique_ptr<MobilityModel> createMobility(const MobilityForce& force, const MobilityScene&,
                                             const HydrodynamicParticles& particles,
                                             bool) override {
        return make_unique<RecordingModel>(kind, particles, force.getViscosity());
    }

private:
    const Kind kind;
};

class RecordingFactory : public KernelFactory {
public:
    explicit RecordingFactory(const Kind& kind) : kind(kind) {}
    KernelImpl* createKernelImpl(string name, const Platform& platform,
                                 ContextImpl&) const override {
        const Kind ofLoops = kind;
        PlatformParts parts;
        parts.arrays = [](ContextImpl& context) { return make_unique<ReferenceArrays>(context); };
        parts.loops = [ofLoops](ContextImpl&) { return make_unique<RecordingLoops>(ofLoops); };
        return new RigidBodyKernel(name, platform, parts);
    }

private:
    const Kind kind;
};

class RecordingPlatform : public ReferencePlatform {
public:
    explicit RecordingPlatform(const Kind& kind) {
        platform("Reference");  // loads the library, which needs a platform for its kernels
        registerKernelFactory(IntegrateRigidBodiesKernel::Name(), new RecordingFactory(kind));
    }
};

/** The products of two steps of a few bodies, and what getEffects() says about these steps. */
struct Steps {
    vector<string> asked;
    string difference;  // the finite-difference step; empty: none
    string products;    // empty: those of iterations are exact
};

/** @param change  makes other settings */
Steps takeSteps(
    const Kind& kind, CustomRigidHIIntegrator::Scheme scheme, bool multiblobs, double tolerance,
    const function<void(FluidScene&)>& change = [](FluidScene&) {}) {
    RecordingPlatform recording(kind);
    FluidScene scene(1 / boltzmann, 1e-4);
    scene.fluid->setSolver(MobilityForce::MatrixFree);
    scene.fluid->setSolverTolerance(tolerance);
    scene.integrator.setScheme(scheme);
    for (int b = 0; b < 5; b++)
        scene.add(multiblobs ? boomerangKind() : sphereKind(1 + 0.1 * b),
                  Vec3(4 * (b % 2), 4 * (b / 2), 0.5 * b));
    change(scene);
    asked.clear();
    scene.start(recording);
    auto effects = scene.integrator.getEffects();
    scene.integrator.step(2);
    const auto after = [&](const string& effect, const string& words) {
        const size_t place = effects[effect].find(words);
        return place == string::npos ? string() : effects[effect].substr(place + words.size());
    };
    Steps steps;
    steps.asked = asked;
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
    0.01: 0
    0.0001: 0
    5e-05: 0
    1e-06: 0
    1e-08: 0
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
    0.01: step 0.01, 0
    0.0001: step 0.01, 0
    5e-05: step 0.01, 0
    1e-06: step 1e-05, 0
    1e-08: step 1e-05, 0
spheres, products of single precision
  LangevinHI
    0.01: 1e-06
    0.0001: 1e-06
    5e-05: 1e-06
    1e-06: 0 1e-06
    1e-08: 0 1e-06
  EulerMaruyama
  FixmanMidpoint
    0.01: 1e-06 0
    0.0001: 1e-06 0
    5e-05: 1e-06 0
    1e-06: 0 1e-06
    1e-08: 0 1e-06
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
    0.0001: step 0.01, 0 1e-06
    5e-05: step 0.01, 0 1e-06
    1e-06: step 1e-05, 0 1e-06
    1e-08: step 1e-05, 0 1e-06
spheres, fast products
  LangevinHI
    0.01: 0.001
    0.0001: 1e-05
    5e-05: 5e-06
    1e-06: 0 1e-06
    1e-08: 0 1e-06
  EulerMaruyama
  FixmanMidpoint
    0.01: 0.001 0.0001
    0.0001: 1e-05 1e-06
    5e-05: 5e-06 5e-07
    1e-06: 0 1e-06
    1e-08: 0 1e-06
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
    1e-06: step 1e-05, 0 1e-06
    1e-08: step 1e-05, 0 1e-06
spheres, fast products without drift
  LangevinHI
    0.01: 0.001
    0.0001: 1e-05
    5e-05: 5e-06
    1e-06: 0 1e-06
    1e-08: 0 1e-06
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
    1e-06: 0 1e-06
    1e-08: 0 1e-06
multiblobs, exact products
  LangevinHI
  EulerMaruyama
  FixmanMidpoint
    0.01: 0
    0.0001: 0
    5e-05: 0
    1e-06: 0
    1e-08: 0
  RandomFiniteDifference
    0.01: step 0.01, 0
    0.0001: step 0.01, 0
    5e-05: step 0.01, 0
    1e-06: step 0.01, 0
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
    0.01: step 0.01, 0
    0.0001: step 0.01, 0
    5e-05: step 0.01, 0
    1e-06: step 1e-05, 0
    1e-08: step 1e-05, 0
multiblobs, products of single precision
  LangevinHI
    0.01: 1e-06
    0.0001: 1e-06 0
    5e-05: 1e-06 0
    1e-06: 1e-06 0
    1e-08: 1e-06 0
  EulerMaruyama
  FixmanMidpoint
    0.01: 1e-06
    0.0001: 1e-06
    5e-05: 1e-06
    1e-06: 0 1e-06
    1e-08: 0 1e-06
  RandomFiniteDifference
    0.01: step 0.01, 1e-06
    0.0001: step 0.01, 0 1e-06
    5e-05: step 0.01, 0 1e-06
    1e-06: step 0.01, 0 1e-06
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
    0.0001: step 0.01, 0 1e-06
    5e-05: step 0.01, 0 1e-06
    1e-06: step 1e-05, 0 1e-06
    1e-08: step 1e-05, 0 1e-06
multiblobs, fast products
  LangevinHI
    0.01: 1e-05
    0.0001: 1e-06 0
    5e-05: 1e-06 0
    1e-06: 1e-06 0
    1e-08: 1e-06 0
  EulerMaruyama
  FixmanMidpoint
    0.01: 0.00041 0.0002
    0.0001: 4.1e-06 2e-06
    5e-05: 2.1e-06 1e-06
    1e-06: 0 1e-06
    1e-08: 0 1e-06
  RandomFiniteDifference
    0.01: step 0.01, 1e-06
    0.0001: step 0.01, 0 1e-06
    5e-05: step 0.01, 0 1e-06
    1e-06: step 0.01, 0 1e-06
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
    1e-06: step 1e-05, 0 1e-06
    1e-08: step 1e-05, 0 1e-06
)";

}  // namespace

TEST(ErrorBudget, EverySchemeHasTheseProducts) {
    const Kind kinds[] = {{"exact products", false, false, false},
                          {"products of single precision", true, false, false},
                          {"fast products", true, true, false},
                          {"fast products without drift", true, true, true}};
    ostringstream found;
    testing::internal::CaptureStderr();  // warnings that EulerMaruyama omits the drift
    for (bool multiblobs : {false, true})
        for (const Kind& kind : kinds) {
            if (multiblobs && kind.isDivergenceFree) continue;  // K depends on the poses
            vector<pair<string, string>> groups;                // choices, and schemes with them
            for (const SchemeTraits& scheme : schemeTable) {
                if (!scheme.needsFluid()) continue;
                ostringstream text;
                for (double tolerance : {1e-2, 1e-4, 5e-5, 1e-6, 1e-8}) {
                    const Steps steps = takeSteps(kind, scheme.scheme, multiblobs, tolerance);
                    text << "    " << tolerance << ": " << choices(steps) << "\n";
                    EXPECT_TRUE(namesTheFirst(steps))
                        << kind.name << (multiblobs ? ", multiblobs, " : ", spheres, ")
                        << scheme.name << ", " << tolerance << ": " << choices(steps)
                        << "; the text has: " << steps.products;
                }
                const auto known = find_if(groups.begin(), groups.end(), [&](const auto& group) {
                    return group.first == text.str();
                });
                if (known == groups.end())
                    groups.push_back({text.str(), scheme.name});
                else
                    known->second += string("\n  ") + scheme.name;
            }
            found << (multiblobs ? "multiblobs, " : "spheres, ") << kind.name << "\n";
            for (const auto& group : groups) found << "  " << group.second << "\n" << group.first;
        }
    testing::internal::GetCapturedStderr();
    EXPECT_EQ(found.str(), expected);
}

/** describeEffects() reads the budget of the step: the tolerance of differences, and their step. */
TEST(ErrorBudget, EffectsNameTheProductsOfTheStep) {
    const auto text = [](CustomRigidHIIntegrator::Scheme scheme, bool multiblobs, double tolerance,
                         double difference = 0) {
        const Kind kind = {"fast products", true, true, false};
        const auto steps = takeSteps(kind, scheme, multiblobs, tolerance, [=](FluidScene& scene) {
            scene.integrator.setFiniteDifferenceStep(difference);
        });
        return steps.products;
    };
    const auto corrector = CustomRigidHIIntegrator::DriftCorrectorRFD;
    // Differences take a tenth of the tolerance, and begin exactly at 1e-4.
    EXPECT_EQ(text(corrector, true, 1e-3),
              "with errors of 1e-06 for differences, then of roots with errors of 4.1e-05, of "
              "solves with errors of 2e-05");
    EXPECT_EQ(text(corrector, true, 1e-4),
              "of roots over all pairs, of solves with errors of 1e-06 for differences, then of "
              "roots with errors of 4.1e-06, of solves with errors of 2e-06");
    // A short difference needs exact products.
    EXPECT_EQ(text(corrector, true, 1e-3, 1e-3),
              "over all pairs for differences, then of roots with errors of 4.1e-05, of solves "
              "with errors of 2e-05");
    EXPECT_EQ(text(corrector, false, 1e-3, 1e-3),
              "over all pairs for differences, then with errors of 0.0001");
    EXPECT_EQ(text(CustomRigidHIIntegrator::EulerMaruyama, false, 1e-3), "with errors of 0.0001");
    // The only iterations of multiblobs with momenta are solves to a part of the tolerance.
    EXPECT_EQ(text(CustomRigidHIIntegrator::LangevinHI, true, 1e-2), "with errors of 1e-05");
    EXPECT_EQ(text(CustomRigidHIIntegrator::LangevinHI, false, 1e-2), "with errors of 0.001");
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
    const RecordingModel fast({"fast", true, true, false}, none, 1);
    const auto errorsOf = [&](const ErrorBudget& budget, double amplification) {
        vector<double> errors;
        for (const auto& product : budget.inRoots(fast, amplification))
            errors.push_back(product.error);
        return errors;
    };
    EXPECT_EQ(errorsOf(ErrorBudget(1e-3), 1), (vector<double>{1e-4, 1e-5, 1e-6}));
    EXPECT_EQ(errorsOf(ErrorBudget(1e-1), 1), (vector<double>{1e-3, 1e-3, 1e-6}));
    EXPECT_EQ(errorsOf(ErrorBudget(1e-3), 20), (vector<double>{5e-6, 1e-6}));
    EXPECT_EQ(errorsOf(ErrorBudget(1e-8), 1), (vector<double>{1e-6}));
    EXPECT_EQ(errorsOf(ErrorBudget::beforeSteps(1e-3), 1), (vector<double>{1e-6}));
    // From this tolerance on, single precision is right from the first product on.
    EXPECT_TRUE(ErrorBudget(5e-5).inRoots(fast, 1).back().atOnce);
    EXPECT_FALSE(ErrorBudget(4.9e-5).inRoots(fast, 1).back().atOnce);
    // The longest difference leaves single precision, shorter ones a share of it.
    ErrorBudget::Needs needed;
    needed.largeErrors = false;
    EXPECT_EQ(errorsOf(ErrorBudget(1e-3, needed), 1), (vector<double>{1e-6}));
    EXPECT_EQ(ErrorBudget(1e-3, needed).inSolves(fast, 1e-4), 1e-6);
    needed.exactProducts = true;
    EXPECT_TRUE(errorsOf(ErrorBudget(1e-3, needed), 1).empty());
    EXPECT_EQ(ErrorBudget(1e-3, needed).inSolves(fast, 1e-4), 0);
    needed.shareOfInexact = 1e-7;
    EXPECT_EQ(errorsOf(ErrorBudget(1e-3, needed), 1), (vector<double>{1e-6}));
    // Solves take what is useful to them, between both limits.
    EXPECT_EQ(ErrorBudget(1e-3).inSolves(fast, 1e-2), 1e-3);
    EXPECT_EQ(ErrorBudget(1e-3).inSolves(fast, 1e-5), 1e-5);
    EXPECT_EQ(ErrorBudget(1e-3).inSolves(fast, 1e-8), 1e-6);
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
    const RecordingModel host({"host", true, false, false}, none, 1),
        device({"device", true, false, false, true}, none, 1);
    ErrorBudget::Needs needed;
    const auto error = [&](double tolerance, const RecordingModel& model) {
        return ErrorBudget(tolerance, needed).ofProductsAsSolves(model).error;
    };
    needed.exactSolves = false;
    EXPECT_EQ(error(1e-2, device), 1e-4);
    EXPECT_EQ(error(1e-2, host), 0);
    EXPECT_EQ(error(9e-5, device), 0);
    needed.exactSolves = true;
    EXPECT_EQ(error(1e-2, device), 0);
    EXPECT_TRUE(ErrorBudget::savesTime(device, 1e-6));
    EXPECT_FALSE(ErrorBudget::savesTime(device, 9e-7));
    EXPECT_FALSE(ErrorBudget::savesTime(host, 1e-2));
    // Iterations ask for no larger errors, which would take as long.
    EXPECT_EQ(ErrorBudget(1e-3).inRoots(device, 1).size(), 1u);
    EXPECT_EQ(ErrorBudget(1e-3).inSolves(device, 1e-2), Accuracy::errorOfSinglePrecision);
}

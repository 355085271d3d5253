#include "context/Mismatches.h"

#include <openmm/CustomCVForce.h>
#include <openmm/CustomGBForce.h>
#include <openmm/CustomHbondForce.h>
#include <openmm/CustomManyParticleForce.h>
#include <openmm/CustomNonbondedForce.h>
#include <openmm/GBSAOBCForce.h>
#include <openmm/GayBerneForce.h>
#include <openmm/MonteCarloAnisotropicBarostat.h>
#include <openmm/MonteCarloBarostat.h>
#include <openmm/MonteCarloMembraneBarostat.h>
#include <openmm/NonbondedForce.h>

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "context/FluidMismatches.h"
#include "context/ForcesBetweenGroups.h"
#include "context/Messages.h"
#include "context/Scene.h"
#include "fluid/FluidReport.h"
#include "openmmrigidhi/MobilityForce.h"

using namespace OpenMM;
using namespace std;

namespace RigidHIPlugin {

string bodiesWithoutContext(const Scene& scene) {
    const int later = scene.integrator.getNumRigidBodies() - scene.definitions.getNumBodies();
    if (later <= 0) return {};
    return counted(later, "body was", "bodies were") +
           " added after the creation of this Context, whose steps do not move " +
           (later == 1 ? "it as a rigid body" : "them as rigid bodies") +
           "; call reinitialize(preserveState=False) on the Context and set "
           "positions, or add bodies before you create the Context";
}

string jointsWithoutContext(const Scene& scene) {
    const int joints = scene.integrator.getNumJoints() - int(scene.definitions.joints().size()),
              motors =
                  scene.integrator.getNumHingeMotors() - int(scene.definitions.motors().size());
    if (joints <= 0 && motors <= 0) return {};
    const string them = joints > 0 ? counted(joints, "joint was", "joints were")
                                   : counted(motors, "motor was", "motors were");
    return them +
           " added after the creation of this Context, whose steps do not know of it; call "
           "reinitialize(preserveState=True) on the Context, or add joints and motors before you "
           "create the Context";
}

/** Whether bodies interact in a fluid with this boundary, which has no images, as forces have. */
static bool lacksImages(const Scene& scene, MobilityForce::Boundary boundary) {
    const MobilityForce* fluid = scene.fluid.getParameters();
    if (!fluid || fluid->getBoundary() != boundary ||
        !scene.system.usesPeriodicBoundaryConditions())
        return false;
    // Bodies that do not feel each other need no images of each other.
    return scene.fluid && FluidReport(scene.fluid->getContents()).numInteracting() > 0;
}

string unboundedFluidWithPeriodicForces(const Scene& scene) {
    if (!lacksImages(scene, MobilityForce::Unbounded)) return {};
    return "the fluid is unbounded, though forces are periodic: bodies feel images of each other "
           "by forces, but not through the fluid; use setBoundary(Periodic), or forces without "
           "periodic boundary conditions";
}

string lubricationWithoutEffect(const Scene& scene) {
    return scene.fluid ? FluidReport(scene.fluid->getContents()).lubricationWithoutEffect()
                       : string();
}

string watersWithoutBodies(const Scene& scene) {
    const SystemInventory& stock = scene.stock;
    if (stock.numFreeWaters == 0) return {};
    return counted(stock.numFreeWaters, "rigid water is in no body, so that each step solves its",
                   "rigid waters are in no body, so that each step solves their") +
           " constraints (the first water begins with particle " + to_string(stock.firstFreeWater) +
           "); call openmmrigidhi.app.addRigidWater() before you create the Context to make rigid "
           "bodies of waters";
}

string barostatAtAnotherTemperature(const Scene& scene) {
    const CustomRigidHIIntegrator& integrator = scene.integrator;
    if (scene.stock.barostatTemperature.empty()) return {};
    const double ofBarostat = scene.contextParameters.at(scene.stock.barostatTemperature),
                 own = integrator.getTemperature(), rounding = 1e-6;
    if (abs(ofBarostat - own) <= rounding * own) return {};
    // Without friction nothing has the integrator's temperature.
    bool heated = integrator.getFriction() > 0 || integrator.getRotationalFriction() > 0;
    for (int b = 0; b < scene.definitions.getNumBodies(); b++) {
        double gamma, Gamma;
        integrator.getBodyFriction(b, gamma, Gamma);
        heated = heated || gamma > 0 || Gamma > 0;
    }
    if (!heated) return {};
    return "the " + scene.stock.barostat + " is at " + number(ofBarostat) +
           " K, but the integrator at " + number(own) +
           " K: set one temperature by setTemperature() and by the Context's parameter " +
           scene.stock.barostatTemperature;
}

namespace {

/** How forces feel images. */
struct ForcesAcross {
    double cutoff = 0;      // the largest of forces with periodic images, nm
    int force = -1;         // the force with this cutoff
    bool isSummed = false;  // charges are summed over all images
};

bool hasCharges(const NonbondedForce& force) {
    for (int p = 0; p < force.getNumParticles(); p++) {
        double charge, sigma, epsilon;
        force.getParticleParameters(p, charge, sigma, epsilon);
        if (charge != 0) return true;
    }
    return force.getNumParticleParameterOffsets() > 0;
}

/** The cutoff of a force of this class; 0 if it is of another class, or sees no images. */
template <class Cutoff>
double cutoffOfImages(const Force& force) {
    const auto* known = dynamic_cast<const Cutoff*>(&force);
    return known && known->getNonbondedMethod() == Cutoff::CutoffPeriodic
               ? known->getCutoffDistance()
               : 0;
}

void findImages(const Force& force, int index, ForcesAcross& found) {
    double cutoff = max(
        {cutoffOfImages<CustomNonbondedForce>(force), cutoffOfImages<CustomGBForce>(force),
         cutoffOfImages<CustomHbondForce>(force), cutoffOfImages<CustomManyParticleForce>(force),
         cutoffOfImages<GayBerneForce>(force), cutoffOfImages<GBSAOBCForce>(force)});
    if (auto* nonbonded = dynamic_cast<const NonbondedForce*>(&force)) {
        const auto method = nonbonded->getNonbondedMethod();
        const bool isPeriodic =
            method != NonbondedForce::NoCutoff && method != NonbondedForce::CutoffNonPeriodic;
        if (isPeriodic) cutoff = nonbonded->getCutoffDistance();
        if (isPeriodic && method != NonbondedForce::CutoffPeriodic && hasCharges(*nonbonded))
            found.isSummed = true;
    }
    if (cutoff > found.cutoff) {
        found.cutoff = cutoff;
        found.force = index;
    }
    if (auto* variables = dynamic_cast<const CustomCVForce*>(&force))
        for (int v = 0; v < variables->getNumCollectiveVariables(); v++)
            findImages(variables->getCollectiveVariable(v), index, found);
}

ForcesAcross findForcesAcross(const System& system) {
    ForcesAcross found;
    for (int i = 0; i < system.getNumForces(); i++) findImages(system.getForce(i), i, found);
    return found;
}

/** z of the highest particle that the fluid sees. */
double findHighest(const Scene& scene) {
    const MobilityForce& fluid = *scene.fluid.getParameters();
    double highest = -INFINITY;
    for (int p = 0; p < fluid.getNumParticles(); p++)
        if (fluid.getParticleRadius(p) > 0) highest = max(highest, scene.arrays->positions()[p][2]);
    return highest;
}

}  // namespace

string imagesAcrossTheFluid(const Scene& scene) {
    if (!scene.fluid || !scene.fluid->getContents().userFlow.hasPlanes()) return {};
    const UserFlow& planes = scene.fluid->getContents().userFlow;
    const ForcesAcross forces = findForcesAcross(scene.system);
    const double edge = scene.getBox()[2][2],
                 upTo = isfinite(planes.high) ? planes.high : findHighest(scene),
                 range = upTo - planes.low;
    const string beside = string("boundary ") +
                          traitsOf(scene.fluid.getParameters()->getBoundary()).name +
                          " has no images along z, but forces do: ";
    string text;
    if (forces.force >= 0 && edge < range + forces.cutoff)
        text = beside + "the box is " + number(edge) + " nm along z, less than the " +
               number(range) + " nm where particles are and the cut-off of force " +
               to_string(forces.force) + ", " + number(forces.cutoff) +
               " nm, so particles feel images of others through the walls; make the third "
               "vector of the box " +
               number(range + forces.cutoff) + " nm or longer, which does not change the fluid";
    if (forces.isSummed)
        text += (text.empty() ? beside : string("; and ")) +
                "Ewald sums of charges include all images along z; leave a gap along z by a longer "
                "third vector of the box, and add the correction for slabs (Yeh and Berkowitz, J. "
                "Chem. Phys. 111, 3155, 1999), or use a cut-off";
    return text;
}

namespace {

/** The axes along which the fluid has images. */
vector<int> periodicAxes(const Scene& scene) {
    const MobilityForce* fluid = scene.fluid.getParameters();
    if (!fluid || !scene.fluid) return {};
    const BoundaryTraits& boundary = traitsOf(fluid->getBoundary());
    if (!boundary.isPeriodic) return {};
    vector<int> axes;
    for (int axis = 0; axis < 3; axis++)
        if (!boundary.isAcross(axis)) axes.push_back(axis);
    return axes;
}

/** How far the particles that the fluid sees are apart along an axis, at most. */
double extentAlong(const Scene& scene, int axis) {
    const MobilityForce& fluid = *scene.fluid.getParameters();
    double least = INFINITY, most = -INFINITY;
    for (int p = 0; p < fluid.getNumParticles(); p++)
        if (fluid.getParticleRadius(p) > 0) {
            const double x = scene.arrays->positions()[p][axis];
            least = min(least, x);
            most = max(most, x);
        }
    return most - least;
}

/** The range of a pair force of this class that sees no images; 0 if there is no such force. */
template <class Pairs>
double rangeWithoutImages(const Force& force) {
    const auto* known = dynamic_cast<const Pairs*>(&force);
    if (!known || known->getNumParticles() < 2) return 0;
    if (known->getNonbondedMethod() == Pairs::CutoffNonPeriodic) return known->getCutoffDistance();
    return known->getNonbondedMethod() == Pairs::NoCutoff ? INFINITY : 0;
}

bool hasInteractions(const NonbondedForce& force) {
    for (int p = 0; p < force.getNumParticles(); p++) {
        double charge, sigma, epsilon;
        force.getParticleParameters(p, charge, sigma, epsilon);
        if (charge != 0 || epsilon != 0) return true;
    }
    return force.getNumParticleParameterOffsets() > 0;
}

}  // namespace

string forcesWithoutImages(const Scene& scene) {
    const vector<int> axes = periodicAxes(scene);
    if (axes.empty() || FluidReport(scene.fluid->getContents()).numInteracting() == 0) return {};
    for (int i = 0; i < scene.system.getNumForces(); i++) {
        const Force& force = scene.system.getForce(i);
        double range = max({rangeWithoutImages<CustomNonbondedForce>(force),
                            rangeWithoutImages<CustomGBForce>(force),
                            rangeWithoutImages<CustomManyParticleForce>(force),
                            rangeWithoutImages<GayBerneForce>(force)});
        if (const auto* nonbonded = dynamic_cast<const NonbondedForce*>(&force))
            if (hasInteractions(*nonbonded)) range = rangeWithoutImages<NonbondedForce>(force);
        if (range == 0) continue;
        for (int axis : axes) {
            const double edge = scene.getBox()[axis][axis], extent = extentAlong(scene, axis);
            // A cluster in the middle of its box is right without images.
            if (isinf(range) ? extent <= edge / 2 : extent + range <= edge) continue;
            return "the fluid is periodic, but force " + to_string(i) + ", a " +
                   string(force.getName()) +
                   ", has no images: particles that meet through a face of the box (" +
                   number(edge) + " nm along " + "xyz"[axis] +
                   ") do not feel each other by this force, and can overlap; use "
                   "setNonbondedMethod(CutoffPeriodic) of this force, or a longer box";
        }
    }
    return {};
}

string wallWithPeriodicForces(const Scene& scene) {
    if (!lacksImages(scene, MobilityForce::NoSlipWall)) return {};
    const ForcesAcross forces = findForcesAcross(scene.system);
    for (int axis : {0, 1}) {
        const double edge = scene.getBox()[axis][axis], extent = extentAlong(scene, axis);
        // The wall screens what images of a cluster would add.
        if (forces.isSummed ? extent <= edge / 2 : extent + forces.cutoff <= edge) continue;
        return "the fluid above the NoSlipWall has no images, though forces are periodic and "
               "particles are up to " +
               number(extent) + " nm apart along " + "xyz"[axis] + " in a box of " + number(edge) +
               " nm: bodies feel images of each other by forces, but not through the fluid; use "
               "setBoundary(PeriodicWall), or forces without periodic boundary conditions";
    }
    return {};
}

string boxOfTheDefault(const Scene& scene) {
    const double edgeOfDefault = 2;  // of OpenMM's System, nm
    for (int axis : periodicAxes(scene)) {
        const Vec3 edge = scene.getBox()[axis];
        for (int k = 0; k < 3; k++)
            if (edge[k] != (k == axis ? edgeOfDefault : 0)) return {};
    }
    for (int axis : periodicAxes(scene)) {
        const double extent = extentAlong(scene, axis);
        if (extent > 2 * edgeOfDefault)
            return "the box of the periodic fluid has edges of 2 nm, as OpenMM's System has them "
                   "by default, but particles are up to " +
                   number(extent) + " nm apart along " + "xyz"[axis] +
                   "; set the box by setDefaultPeriodicBoxVectors() of the System, or by "
                   "setPeriodicBoxVectors() of the Context";
    }
    return {};
}

namespace {

void addFound(const vector<pair<WarningCause, string>>& found, Warnings& warnings) {
    for (const auto& mismatch : found)
        if (!mismatch.second.empty()) warnings.insert(mismatch);
}

}  // namespace

void addMismatchesOfPositions(const Scene& scene, Warnings& warnings) {
    addFound({{WarningCause::ForcesWithoutImages, forcesWithoutImages(scene)},
              {WarningCause::ForcesBetweenGroups, forcesBetweenGroups(scene)},
              {WarningCause::WallWithPeriodicForces, wallWithPeriodicForces(scene)},
              {WarningCause::BoxOfTheDefault, boxOfTheDefault(scene)},
              {WarningCause::ImagesAcross, imagesAcrossTheFluid(scene)}},
             warnings);
}

void addMismatches(const Scene& scene, Warnings& warnings) {
    addFound({{WarningCause::BodiesWithoutContext, bodiesWithoutContext(scene)},
              {WarningCause::JointsWithoutContext, jointsWithoutContext(scene)},
              {WarningCause::FluidWithoutUpdate, fluidWithoutUpdate(scene)},
              {WarningCause::UnboundedFluid, unboundedFluidWithPeriodicForces(scene)},
              {WarningCause::WatersWithoutBodies, watersWithoutBodies(scene)},
              {WarningCause::BarostatTemperature, barostatAtAnotherTemperature(scene)},
              {WarningCause::LubricationWithoutEffect, lubricationWithoutEffect(scene)},
              {WarningCause::SettingWithoutEffect, settingWithoutEffect(scene)}},
             warnings);
    addMismatchesOfPositions(scene, warnings);
}

string describeBarostat(const Scene& scene) {
    if (scene.stock.barostat.empty()) return "the System has none";
    vector<pair<string, string>> pressures;  // name and unit, and parameter of the Context
    for (int i = 0; i < scene.system.getNumForces(); i++) {
        const Force& force = scene.system.getForce(i);
        if (dynamic_cast<const MonteCarloBarostat*>(&force))
            pressures = {{"bar", MonteCarloBarostat::Pressure()}};
        if (dynamic_cast<const MonteCarloAnisotropicBarostat*>(&force))
            pressures = {{"bar along x", MonteCarloAnisotropicBarostat::PressureX()},
                         {"bar along y", MonteCarloAnisotropicBarostat::PressureY()},
                         {"bar along z", MonteCarloAnisotropicBarostat::PressureZ()}};
        if (dynamic_cast<const MonteCarloMembraneBarostat*>(&force))
            pressures = {
                {"bar", MonteCarloMembraneBarostat::Pressure()},
                {"bar nm of surface tension", MonteCarloMembraneBarostat::SurfaceTension()}};
    }
    string text = "the System has a " + scene.stock.barostat + " at " +
                  number(scene.contextParameters.at(scene.stock.barostatTemperature)) + " K";
    for (const auto& pressure : pressures)
        text += ", " + number(scene.contextParameters.at(pressure.second)) + " " + pressure.first;
    return text;
}

}  // namespace RigidHIPlugin

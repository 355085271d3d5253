#include "context/MemberMismatches.h"

#include <openmm/CMAPTorsionForce.h>
#include <openmm/CustomAngleForce.h>
#include <openmm/CustomBondForce.h>
#include <openmm/CustomCentroidBondForce.h>
#include <openmm/CustomCompoundBondForce.h>
#include <openmm/CustomExternalForce.h>
#include <openmm/CustomNonbondedForce.h>
#include <openmm/CustomTorsionForce.h>
#include <openmm/HarmonicAngleForce.h>
#include <openmm/HarmonicBondForce.h>
#include <openmm/NonbondedForce.h>
#include <openmm/PeriodicTorsionForce.h>
#include <openmm/RBTorsionForce.h>
#include <openmm/reference/SimTKOpenMMRealType.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <numeric>
#include <unordered_set>
#include <vector>

#include "context/Messages.h"
#include "context/Scene.h"
#include "openmmrigidhi/CustomBodyForce.h"
#include "openmmrigidhi/MobilityForce.h"

using namespace OpenMM;
using namespace std;

namespace RigidHIPlugin {

namespace {

/** The widest gap between numbers. */
double widestGap(vector<double>& numbers) {
    sort(numbers.begin(), numbers.end());
    double widest = 0;
    for (size_t i = 1; i < numbers.size(); i++) widest = max(widest, numbers[i] - numbers[i - 1]);
    return widest;
}

/** A position in units of box vectors, which have OpenMM's reduced form. */
Vec3 fractional(const Vec3& position, const BoxVectors& box) {
    Vec3 rest = position, result;
    for (int k = 2; k >= 0; k--) {
        result[k] = rest[k] / box[k][k];
        rest -= box[k] * result[k];
    }
    return result;
}

}  // namespace

string bodiesAcrossTheBox(const Scene& scene) {
    if (!scene.system.usesPeriodicBoundaryConditions()) return {};
    const BoxVectors box = scene.getBox();
    int count = 0, first = 0, axisOfFirst = 0;
    double gapOfFirst = 0;
    vector<double> along[3];
    for (int b = 0; b < scene.definitions.getNumBodies(); b++) {
        if (scene.definitions.isExplicit(b)) continue;  // its shape is not from positions
        const vector<int>& members = scene.definitions.particles(b);
        for (auto& numbers : along) numbers.clear();
        for (int p : members) {
            const Vec3 f = fractional(scene.arrays->positions()[p], box);
            for (int k = 0; k < 3; k++) along[k].push_back(f[k]);
        }
        for (int k = 0; k < 3; k++) {
            const double gap = widestGap(along[k]);
            if (!(gap > 0.5)) continue;
            if (count++ == 0) {
                first = b;
                axisOfFirst = k;
                gapOfFirst = gap * box[k][k];
            }
            break;
        }
    }
    if (count == 0) return {};
    return "the particles of body " + to_string(first) + " lie in two parts " + number(gapOfFirst) +
           " nm apart along " + "xyz"[axisOfFirst] + ", more than half of the periodic box" +
           (count == 1 ? string()
                       : ", as do those of " + counted(count - 1, "other body", "other bodies")) +
           ": molecules seem to be wrapped into the box particle by particle, and this has become "
           "the shape of bodies; give positions of openmmrigidhi.app.makeWhole(), after "
           "resetBodyGeometry() if a Context has seen the others";
}

namespace {

/** Pairs of particles in any order. */
class Pairs {
public:
    void insert(int a, int b) { keys.insert(key(a, b)); }
    bool contains(int a, int b) const { return keys.count(key(a, b)) > 0; }

private:
    static long long key(int a, int b) {
        return (static_cast<long long>(min(a, b)) << 32) | static_cast<long long>(max(a, b));
    }
    unordered_set<long long> keys;
};

/** Forces may have been added, or be incomplete, since the creation of the Context. */
bool isComplete(const NonbondedForce& force, const Scene& scene) {
    const size_t n = scene.stock.bodyOfParticle.size();
    if (static_cast<size_t>(force.getNumParticles()) != n) return false;
    for (int e = 0; e < force.getNumExceptions(); e++) {
        int a, b;
        double charge, sigma, epsilon;
        force.getExceptionParameters(e, a, b, charge, sigma, epsilon);
        if (min(a, b) < 0 || static_cast<size_t>(max(a, b)) >= n) return false;
    }
    return true;
}

/** A NonbondedForce's parameters. */
struct Nonbonded {
    explicit Nonbonded(const NonbondedForce& force) {
        const int n = force.getNumParticles();
        charges.resize(n);
        sigmas.resize(n);
        epsilons.resize(n);
        for (int p = 0; p < n; p++)
            force.getParticleParameters(p, charges[p], sigmas[p], epsilons[p]);
        for (int e = 0; e < force.getNumExceptions(); e++) {
            int a, b;
            double charge, sigma, epsilon;
            force.getExceptionParameters(e, a, b, charge, sigma, epsilon);
            exceptions.insert(a, b);
        }
    }
    bool acts(int p) const { return charges[p] != 0 || epsilons[p] != 0; }
    /**
     * The size of the energies of a pair, each times the power of the distance with which it
     * changes, kJ/mol: a relative error of the distance changes them by this.
     */
    double sensitivity(int a, int b, double r) const {
        const double s = pow(0.5 * (sigmas[a] + sigmas[b]) / r, 6);
        return ONE_4PI_EPS0 * abs(charges[a] * charges[b]) / r +
               4 * sqrt(epsilons[a] * epsilons[b]) * s * (12 * s + 6);
    }
    vector<double> charges, sigmas, epsilons;
    Pairs exceptions;
};

}  // namespace

string forcesWithinBodies(const Scene& scene) {
    // Single precision keeps seven digits of a distance. Errors of pairs add up like random
    // numbers.
    const double rounding = 1e-7, share = 0.1;
    if (scene.forcesAreExact || !scene.isBuilt() || scene.settings.kT == 0) return {};
    const double most = share * scene.settings.kT / rounding;
    const long long mostPairs = 1000 * 1000;
    for (int i = 0; i < scene.system.getNumForces(); i++) {
        const auto* force = dynamic_cast<const NonbondedForce*>(&scene.system.getForce(i));
        if (!force || !isComplete(*force, scene)) continue;
        const Nonbonded forces(*force);
        const double reach = force->getNonbondedMethod() == NonbondedForce::NoCutoff
                                 ? INFINITY
                                 : force->getCutoffDistance();
        double sum = 0, strongest = 0;
        int a = -1, b = -1, body = -1;
        long long pairs = 0;
        for (int k = 0; k < scene.definitions.getNumBodies() && pairs < mostPairs; k++) {
            const vector<int>& members = scene.definitions.particles(k);
            const vector<Vec3>& sites = scene.definitions.geometries()[k].sites;
            for (size_t m = 0; m < members.size() && pairs < mostPairs; m++) {
                if (!forces.acts(members[m])) continue;
                for (size_t n = 0; n < m; n++, pairs++) {
                    if (forces.exceptions.contains(members[m], members[n])) continue;
                    const Vec3 d = sites[m] - sites[n];
                    const double r = sqrt(d.dot(d));
                    if (r > reach) continue;
                    const double energy = forces.sensitivity(members[m], members[n], r);
                    sum += energy * energy;
                    if (!(energy > strongest)) continue;
                    strongest = energy;
                    a = members[n];
                    b = members[m];
                    body = k;
                }
            }
        }
        if (sqrt(sum) <= most) continue;
        return "force " + to_string(i) + ", a " + string(force->getName()) +
               ", acts between particles of one body, such as " + to_string(a) + " and " +
               to_string(b) + " of body " + to_string(body) +
               ", so strongly that in single precision the rounding of energies, about " +
               text(rounding * sqrt(sum), 2) +
               " kJ/mol in all bodies, "
               "disturbs barostats and minimisers; exclude these pairs by "
               "openmmrigidhi.app.excludeWithinBodies()";
    }
    return {};
}

namespace {

/** Which particles hold together. */
class Molecules {
public:
    explicit Molecules(int numParticles) : parent(numParticles) {
        iota(parent.begin(), parent.end(), 0);
    }
    void join(int a, int b) {
        const int n = parent.size();
        if (min(a, b) >= 0 && max(a, b) < n) parent[root(a)] = root(b);
    }
    bool areOne(int a, int b) { return root(a) == root(b); }

private:
    int root(int p) {
        while (parent[p] != p) p = parent[p] = parent[parent[p]];
        return p;
    }
    vector<int> parent;
};

/**
 * Join what a Force of bonds joins.
 *
 * @return whether the Force is known, so that what it does not join it leaves apart
 */
bool joinBonds(const Force& force, Molecules& molecules) {
    int a, b;
    double length, k;
    if (const auto* bonds = dynamic_cast<const HarmonicBondForce*>(&force)) {
        for (int i = 0; i < bonds->getNumBonds(); i++) {
            bonds->getBondParameters(i, a, b, length, k);
            if (k != 0) molecules.join(a, b);
        }
        return true;
    }
    if (const auto* bonds = dynamic_cast<const CustomBondForce*>(&force)) {
        vector<double> parameters;
        for (int i = 0; i < bonds->getNumBonds(); i++) {
            bonds->getBondParameters(i, a, b, parameters);
            molecules.join(a, b);
        }
        return true;
    }
    // Angles and torsions alone hold nothing together, and are between particles with bonds.
    return dynamic_cast<const NonbondedForce*>(&force) ||
           dynamic_cast<const CustomNonbondedForce*>(&force) ||
           dynamic_cast<const HarmonicAngleForce*>(&force) ||
           dynamic_cast<const CustomAngleForce*>(&force) ||
           dynamic_cast<const PeriodicTorsionForce*>(&force) ||
           dynamic_cast<const RBTorsionForce*>(&force) ||
           dynamic_cast<const CustomTorsionForce*>(&force) ||
           dynamic_cast<const CMAPTorsionForce*>(&force);
}

}  // namespace

string looseParticles(const Scene& scene) {
    const System& system = scene.system;
    if (scene.stock.freeParticles.size() < 2) return {};
    if (scene.stock.bodyOfParticle.size() != static_cast<size_t>(system.getNumParticles()))
        return {};
    Molecules molecules(system.getNumParticles());
    for (int i = 0; i < system.getNumConstraints(); i++) {
        int a, b;
        double length;
        system.getConstraintParameters(i, a, b, length);
        molecules.join(a, b);
    }
    for (int i = 0; i < system.getNumForces(); i++) {
        const Force& force = system.getForce(i);
        const string name = force.getName();
        // Other Forces may hold particles together, in ways that this function does not know.
        if (!joinBonds(force, molecules) && name.find("Barostat") == string::npos &&
            name.find("Remover") == string::npos && name.find("Thermostat") == string::npos &&
            !dynamic_cast<const MobilityForce*>(&force))
            return {};
    }
    const auto isFree = [&](int p) {
        return scene.stock.bodyOfParticle[p] < 0 && system.getParticleMass(p) > 0;
    };
    for (int i = 0; i < system.getNumForces(); i++) {
        const auto* force = dynamic_cast<const NonbondedForce*>(&system.getForce(i));
        if (!force || !isComplete(*force, scene)) continue;
        const Nonbonded forces(*force);
        const auto areNear = [&](int a, int b) {
            const double bond = 0.2, ofSigma = 0.35;  // nm; of the sum of two
            const Vec3 d = scene.arrays->positions()[a] - scene.arrays->positions()[b];
            const double r = sqrt(d.dot(d));
            return r > 0 && r < max(bond, ofSigma * (forces.sigmas[a] + forces.sigmas[b]));
        };
        for (int e = 0; e < force->getNumExceptions(); e++) {
            int a, b;
            double charge, sigma, epsilon;
            force->getExceptionParameters(e, a, b, charge, sigma, epsilon);
            if (charge != 0 || epsilon != 0 || !isFree(a) || !isFree(b) || molecules.areOne(a, b) ||
                !forces.acts(a) || !forces.acts(b) || !areNear(a, b))
                continue;
            return "particles " + to_string(a) + " and " + to_string(b) +
                   " exclude each other from force " + to_string(i) + ", a " +
                   string(force->getName()) +
                   ", as those of a molecule do, but they are in no body, and no bond or "
                   "constraint holds them together, so that they will fly apart; call "
                   "addRigidBody() or openmmrigidhi.app.addRigidResidues() for every rigid "
                   "molecule before you create the Context";
        }
    }
    return {};
}

string inertiaAgainstMasses(const Scene& scene) {
    // Users scale masses and moments, and units are wrong by factors of 100 and more.
    const double wrongUnit = 90, rounding = 0.01;
    if (!scene.isBuilt() || !scene.settings.hasMomenta()) return {};
    for (int b = 0; b < scene.definitions.getNumBodies(); b++) {
        if (!scene.definitions.isExplicit(b) || scene.bodies.isHeld(b)) continue;
        const BodyGeometry& g = scene.definitions.geometries()[b];
        const vector<int>& members = scene.definitions.particles(b);
        double mass = 0;
        Vec3 centre;
        for (size_t i = 0; i < members.size(); i++) {
            const double m = scene.system.getParticleMass(members[i]);
            mass += m;
            centre += g.sites[i] * m;
        }
        if (mass == 0 || g.mass == 0) continue;
        centre /= mass;
        const string name = "body " + to_string(b),
                     remedy =
                         "; give masses in dalton, lengths in nm and moments in dalton nm^2, "
                         "or addRigidBody(particles) alone, which takes all of them from the "
                         "System";
        const double ratio = g.mass / mass;
        // Equal masses may be dummies, which the body's own mass replaces.
        const bool areDummies = all_of(members.begin(), members.end(), [&](int p) {
            const double m = scene.system.getParticleMass(p);
            return m == 0 || m * members.size() == mass || m == mass;
        });
        if (areDummies && abs(ratio - 1) > rounding) continue;
        if (ratio > wrongUnit || ratio < 1 / wrongUnit)
            return name + " has a mass of " + number(g.mass) + " dalton, but its particles have " +
                   number(mass) + remedy;
        // Other masses than those of the System may belong to another shape.
        if (abs(ratio - 1) > rounding) continue;
        Vec3 moments;
        double size = 0;
        for (size_t i = 0; i < members.size(); i++) {
            const double m = scene.system.getParticleMass(members[i]);
            const Vec3 d = g.sites[i] - centre;
            for (int k = 0; k < 3; k++) moments[k] += m * (d.dot(d) - d[k] * d[k]);
            size += m * d.dot(d) / mass;
        }
        // Spheres have moments that their particle at the centre cannot tell.
        const double largest = max({moments[0], moments[1], moments[2]}), zero = 1e-6;
        if (largest == 0) continue;
        for (int k = 0; k < 3; k++) {
            const double given = g.moments[k];
            const bool isLine = moments[k] < zero * largest;
            if (isLine ? true : given < wrongUnit * moments[k] && given * wrongUnit > moments[k])
                continue;
            return name + " has a moment of inertia of " + number(given) + " dalton nm^2 about " +
                   "xyz"[k] + ", but its particles at their sites have " + number(moments[k]) +
                   remedy;
        }
        // Moments that agree show that the particles make the body, so that its centre is theirs.
        const double agreement = 0.2, away = 0.1;
        bool agree = true;
        for (int k = 0; k < 3; k++)
            agree = agree && abs(g.moments[k] - moments[k]) < agreement * largest;
        if (agree && centre.dot(centre) > away * away * size)
            return name +
                   " has the mass and the moments of its particles, whose centre of mass is " +
                   number(sqrt(centre.dot(centre))) +
                   " nm from the origin of the sites; give sites relative to the centre of mass, "
                   "or addRigidBody(particles) alone, which takes them from the System";
    }
    return {};
}

namespace {

/** Numbers of any use are larger than this, and quantities in newton or joule are smaller. */
bool lacksAvogadro(double value) { return value != 0 && abs(value) < 1e-19; }

/** The name and the value of such a parameter of a Force, or nothing. */
template <class Custom>
pair<string, double> parameterWithoutAvogadro(
    const Force& force, const Scene& scene, int (Custom::*numNames)() const,
    const string& (Custom::*nameOf)(int) const, int (Custom::*numMembers)() const,
    const function<vector<double>(const Custom&, int)>& valuesOf) {
    const auto* custom = dynamic_cast<const Custom*>(&force);
    if (!custom) return {};
    for (int g = 0; g < custom->getNumGlobalParameters(); g++) {
        const string& name = custom->getGlobalParameterName(g);
        // A Force that was added after the creation of the Context has no parameters there.
        const auto value = scene.contextParameters.find(name);
        if (value != scene.contextParameters.end() && lacksAvogadro(value->second)) return *value;
    }
    if ((custom->*numNames)() == 0) return {};
    for (int m = 0; m < (custom->*numMembers)(); m++) {
        const vector<double> values = valuesOf(*custom, m);
        for (size_t k = 0; k < values.size(); k++)
            if (lacksAvogadro(values[k])) return {(custom->*nameOf)(k), values[k]};
    }
    return {};
}

pair<string, double> parameterWithoutAvogadro(const Force& force, const Scene& scene) {
    using External = CustomExternalForce;
    using Bonds = CustomBondForce;
    using Nonbonded = CustomNonbondedForce;
    using Angles = CustomAngleForce;
    using Torsions = CustomTorsionForce;
    using Compounds = CustomCompoundBondForce;
    using Centroids = CustomCentroidBondForce;
    pair<string, double> found = parameterWithoutAvogadro<External>(
        force, scene, &External::getNumPerParticleParameters,
        &External::getPerParticleParameterName, &External::getNumParticles,
        [](const External& custom, int i) {
            int p;
            vector<double> values;
            custom.getParticleParameters(i, p, values);
            return values;
        });
    if (found.first.empty())
        found = parameterWithoutAvogadro<Bonds>(
            force, scene, &Bonds::getNumPerBondParameters, &Bonds::getPerBondParameterName,
            &Bonds::getNumBonds, [](const Bonds& custom, int i) {
                int a, b;
                vector<double> values;
                custom.getBondParameters(i, a, b, values);
                return values;
            });
    if (found.first.empty())
        found = parameterWithoutAvogadro<Nonbonded>(
            force, scene, &Nonbonded::getNumPerParticleParameters,
            &Nonbonded::getPerParticleParameterName, &Nonbonded::getNumParticles,
            [](const Nonbonded& custom, int i) {
                vector<double> values;
                custom.getParticleParameters(i, values);
                return values;
            });
    if (found.first.empty())
        found = parameterWithoutAvogadro<Angles>(
            force, scene, &Angles::getNumPerAngleParameters, &Angles::getPerAngleParameterName,
            &Angles::getNumAngles, [](const Angles& custom, int i) {
                int a, b, c;
                vector<double> values;
                custom.getAngleParameters(i, a, b, c, values);
                return values;
            });
    if (found.first.empty())
        found = parameterWithoutAvogadro<Torsions>(
            force, scene, &Torsions::getNumPerTorsionParameters,
            &Torsions::getPerTorsionParameterName, &Torsions::getNumTorsions,
            [](const Torsions& custom, int i) {
                int a, b, c, d;
                vector<double> values;
                custom.getTorsionParameters(i, a, b, c, d, values);
                return values;
            });
    if (found.first.empty())
        found = parameterWithoutAvogadro<Compounds>(
            force, scene, &Compounds::getNumPerBondParameters, &Compounds::getPerBondParameterName,
            &Compounds::getNumBonds, [](const Compounds& custom, int i) {
                vector<int> particles;
                vector<double> values;
                custom.getBondParameters(i, particles, values);
                return values;
            });
    if (found.first.empty())
        found = parameterWithoutAvogadro<Centroids>(
            force, scene, &Centroids::getNumPerBondParameters, &Centroids::getPerBondParameterName,
            &Centroids::getNumBonds, [](const Centroids& custom, int i) {
                vector<int> groups;
                vector<double> values;
                custom.getBondParameters(i, groups, values);
                return values;
            });
    return found;
}

}  // namespace

static string withoutAvogadro(const pair<string, double>& parameter, const string& place) {
    return "the parameter " + parameter.first + place + " is " + number(parameter.second) +
           ", as if it were in newton or joule: OpenMM's own Forces take kJ/mol and nm, and do "
           "not multiply quantities by Avogadro's number; multiply them by "
           "openmm.unit.AVOGADRO_CONSTANT_NA";
}

string parametersWithoutAvogadro(const Scene& scene) {
    for (int i = 0; i < scene.system.getNumForces(); i++) {
        const Force& force = scene.system.getForce(i);
        const auto found = parameterWithoutAvogadro(force, scene);
        if (!found.first.empty())
            return withoutAvogadro(
                found, " of force " + to_string(i) + ", a " + string(force.getName()) + ",");
    }
    // Other kinds of Forces have global parameters, too.
    for (const auto& parameter : scene.contextParameters)
        if (lacksAvogadro(parameter.second)) return withoutAvogadro(parameter, "");
    return {};
}

string bodyForceWithoutBodies(const Scene& scene) {
    for (int i = 0; i < scene.system.getNumForces(); i++) {
        const auto* force = dynamic_cast<const CustomBodyForce*>(&scene.system.getForce(i));
        if (force && force->getNumBodies() == 0)
            return "force " + to_string(i) +
                   ", a CustomBodyForce, acts on no body; call its addBody() for each body";
    }
    return {};
}

namespace {

/**
 * Whether a sphere at a site of a body is inside a particle of the body, or inside its shell: seen
 * from the site, there are particles in all directions.
 */
bool isInside(const Vec3& site, double radius, const vector<Vec3>& sites,
              const vector<double>& radii) {
    const size_t fewestOfShell = 12;
    const double rounding = 1e-9 * radius, nearDirection = 0.6;  // a cosine
    for (size_t i = 0; i < sites.size(); i++) {
        const double apart = sqrt((site - sites[i]).dot(site - sites[i]));
        if (apart + radius <= radii[i] + rounding) return true;
    }
    if (sites.size() < fewestOfShell) return false;
    for (int x : {-1, 0, 1})
        for (int y : {-1, 0, 1})
            for (int z : {-1, 0, 1}) {
                if (abs(x) + abs(y) + abs(z) == 0) continue;
                const Vec3 direction(x, y, z);
                const bool has = any_of(sites.begin(), sites.end(), [&](const Vec3& each) {
                    const Vec3 d = each - site;
                    return d.dot(direction) >
                           nearDirection * sqrt(d.dot(d) * direction.dot(direction));
                });
                if (!has) return false;
            }
    return true;
}

}  // namespace

string forceOnFluidInsideBody(const Scene& scene) {
    const MobilityForce* fluid = scene.fluid.getParameters();
    for (int i = 0; fluid && scene.isBuilt() && i < fluid->getNumBodyForcesOnFluid(); i++) {
        int body;
        Vec3 site, force;
        double radius;
        fluid->getBodyForceOnFluidParameters(i, body, site, radius, force);
        if (force == Vec3()) continue;
        vector<Vec3> sites;
        vector<double> radii;
        const vector<int>& particles = scene.definitions.particles(body);
        for (size_t k = 0; k < particles.size(); k++) {
            if (fluid->getParticleRadius(particles[k]) == 0) continue;
            sites.push_back(scene.definitions.geometries()[body].sites[k]);
            radii.push_back(fluid->getParticleRadius(particles[k]));
        }
        if (isInside(site, radius, sites, radii))
            return "force " + to_string(i) +
                   " on the fluid (addBodyForceOnFluid()) acts inside body " + to_string(body) +
                   ", where the fluid moves with the body, so that it hardly propels the body; put "
                   "its site outside the body's particles";
    }
    return {};
}

void addMismatchesOfMembers(const Scene& scene, Warnings& warnings) {
    const pair<WarningCause, string> found[] = {
        {WarningCause::BodiesAcrossTheBox, bodiesAcrossTheBox(scene)},
        {WarningCause::ForcesWithinBodies, forcesWithinBodies(scene)},
        {WarningCause::LooseParticles, looseParticles(scene)},
        {WarningCause::InertiaAgainstMasses, inertiaAgainstMasses(scene)},
        {WarningCause::ParametersWithoutAvogadro, parametersWithoutAvogadro(scene)},
        {WarningCause::BodyForceWithoutBodies, bodyForceWithoutBodies(scene)},
        {WarningCause::ForceOnFluidInside, forceOnFluidInsideBody(scene)}};
    for (const auto& mismatch : found)
        if (!mismatch.second.empty()) warnings.insert(mismatch);
}

}  // namespace RigidHIPlugin

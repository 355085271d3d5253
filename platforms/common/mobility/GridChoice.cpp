#include "mobility/GridChoice.h"

#include <algorithm>
#include <cmath>
#include <set>

#include "mobility/Models.h"
#include "mobility/models/confined/ConfinedForceCoupling.h"
#include "mobility/models/confined/ConfinedRotnePragerYamakawaGrid.h"
#include "mobility/models/confined/PlaneModes.h"
#include "mobility/models/confined/WallModes.h"
#include "mobility/models/ewald/EwaldSplitting.h"
#include "mobility/models/ewald/RotnePragerYamakawaGrid.h"
#include "mobility/models/forcecoupling/GridShape.h"
#include "mobility/models/periodic/MostLatticeRows.h"
#include "openmmrigidhi/ModelTraits.h"
#include "openmmrigidhi/SchemeTraits.h"
#include "openmmrigidhi/internal/Messages.h"

using namespace std;

namespace RigidHIPlugin {

namespace {

/**
 * Up to this many rows Auto takes matrices, whose results have no grid error, unless a step is
 * estimated to take longer than this time, and many times as long as on a grid.
 */
const int fewRows = 150;
const double shortStep = 0.05, timesOfGrid = 5;
/** Where few particles fill less of the box, a grid has too many nodes. */
const double leastVolumeFraction = 1e-4;

/**
 * Likewise for matrices whose columns are products on the grid. Iterations take about as many
 * products.
 */
const int fewRowsOfGrid = 30;

// Times in ns on one thread, measured (benchmarks/README.md).
const double timeOfPair = 3200, timeOfEntry = 315;  // of lattice sums
const double timeOfWave = 0.014,   // for each wave of walls, and each row squared; up to twice as
    timeOfWaveOfRow = 3.5;         // much if all particles are at the wall, less if most are away
                                   // from it; and for each row
const double timeOfFactor = 0.04;  // for each row cubed: a factor of a symmetric matrix
const double timeOfEigensystem = 0.4;
const double timeOfTransform = 0.25;  // for each node, each doubling of the number of nodes, and
                                      // each of six transforms
const double timeOfMode = 1;          // for each node: the response of the fluid
const double timeOfNode = 1.2;        // for each node of a stencil, spreading and averaging

/**
 * Correction for the times in EwaldSplitting, which were measured on a faster machine with AVX-512.
 */
const double timesOfSplitting = 1.5;

/** The work of a user's request, for schemes without a fluid. */
const SchemeWork workOfRequest(1, 1, 0, 1);

/**
 * The work of a step of a scheme, including its stochastic drifts.
 *
 * @param isLocal      whether the random field on a grid is one flow (FieldOfModel::isLocal())
 * @param numDrifting  bodies with a stochastic drift
 */
SchemeWork workOf(const SchemeTraits& scheme, bool isLocal, int numDrifting) {
    SchemeWork work = scheme.needsFluid() ? scheme.work : workOfRequest;
    if (numDrifting > 0) {
        work.solves += work.driftSolves;
        work.matrices += work.driftMatrices + work.driftMatricesOfBody * numDrifting;
    }
    if (scheme.differenced == Differenced::Roots && !isLocal) work.fields = work.matrices;
    return work;
}

double volumeOf(const HydrodynamicParticles& particles) {
    double volume = 0;
    for (double a : particles.radii) volume += 4 * M_PI / 3 * a * a * a;
    return volume;
}

/**
 * The part of a layer that particles fill if they are above one wall. Their positions, which
 * determine the height of the layer, are not known here, and would change the choice.
 */
const double filledAboveWall = 0.2;

/**
 * The height of a confined fluid. Above one wall it is that of a layer with room for two particles
 * above each other. The third vector of the box is no period of the fluid, and has no effect.
 */
double heightOf(const MobilityForce& force, const HydrodynamicParticles& particles,
                const BoxVectors& box) {
    double low, high;
    findWalls(force, low, high);
    if (isfinite(high)) return high - low;
    double largest = 0;
    for (double a : particles.radii) largest = max(largest, a);
    return max(4 * largest, volumeOf(particles) / (filledAboveWall * planeArea(box)));
}

/**
 * The box of the fluid's grid, with edges along the axes. For a channel with slip walls, its y edge
 * is twice the channel's width. Along no-slip walls its z edge is the height of the fluid.
 */
BoxVectors boxOfGrid(const MobilityForce& force, const HydrodynamicParticles& particles,
                     BoxVectors box) {
    if (isConfined(force.getBoundary()))
        box[2] = OpenMM::Vec3(0, 0, heightOf(force, particles, box));
    if (force.getBoundary() != MobilityForce::SlipChannel) return box;
    double low, high;
    force.getChannelWalls(low, high);
    box[1] = OpenMM::Vec3(0, 2 * (high - low), 0);
    return box;
}

double forceCouplingProduct(const MobilityForce& force, const HydrodynamicParticles& particles,
                            BoxVectors box) {
    const GridResolution resolution(particles, force.getSolverTolerance(), force.getGridSpacing());
    const bool confined = isConfined(force.getBoundary());
    if (confined) box[2][2] += ConfinedForceCoupling::beyondHeight(particles, force.getBoundary());
    GridShape shape = confined ? resolution.shapeBetweenPlanes(box) : resolution.shapeFor(box);
    shape.mirrored = force.getBoundary() == MobilityForce::SlipChannel;
    const double nodes = (double)shape.size[0] * shape.numRows() * shape.size[2],
                 spacing = max({shape.spacing(0), shape.spacing(1), shape.spacing(2)});
    double time = nodes * (6 * timeOfTransform * log2(nodes) + timeOfMode);
    for (int i = 0; i < particles.size(); i++) {
        const double P = 2 * resolution.cutoff(particles.radii[i]) / spacing;
        time += (particles.hasTorque[i] ? 2 : 1) * timeOfNode * M_PI / 4 * P * P * (P + 4);
    }
    return 1e-9 * time;
}

/** The number of waves in the symmetric product for walls, for particles that touch the walls. */
double wavesOfWalls(const HydrodynamicParticles& particles, const BoxVectors& box) {
    const double longest =
        largestDepth() / *min_element(particles.radii.begin(), particles.radii.end());
    return 6 * planeArea(box) * longest * longest / (8 * M_PI);
}

/**
 * Seconds to make a matrix of lattice sums.
 *
 * @param images  particles with their images, per particle
 */
double secondsOfMatrix(const HydrodynamicParticles& particles, const BoxVectors& box, bool confined,
                       double images = 1) {
    const double rows = particles.numRows, n = images * particles.size(),
                 entries = pow(rows / particles.size(), 2);
    return 1e-9 *
           (n * (n + 1) / 2 * (timeOfPair + timeOfEntry * entries) +
            (confined ? wavesOfWalls(particles, box) * rows * (timeOfWave * rows + timeOfWaveOfRow)
                      : 0));
}

double surfacesProduct(const MobilityForce& force, const HydrodynamicParticles& particles,
                       const BoxVectors& box) {
    double period;
    const double seconds = isConfined(force.getBoundary())
                               ? 1.25 * ConfinedRotnePragerYamakawaGrid::splittingFor(
                                            particles, force.getSolverTolerance(),
                                            force.getGridSpacing(), box, box[2][2], period)
                                            .seconds
                               : EwaldSplitting(kindsOf(particles), force.getSolverTolerance(),
                                                force.getGridSpacing(), box)
                                     .seconds;
    return timesOfSplitting * seconds;
}

/** Whether lattice sums make the matrices. Otherwise their columns are products on the grid. */
bool hasLatticeSums(const MobilityForce& force) {
    return !(force.getModel() == MobilityForce::ForceCoupling && isConfined(force.getBoundary()));
}

/**
 * With lubrication each particle has a stochastic drift.
 *
 * @param box  of the grid (boxOfGrid())
 */
ColumnSeconds secondsOfColumns(const MobilityForce& force, CustomRigidHIIntegrator::Scheme scheme,
                               const HydrodynamicParticles& particles, const BoxVectors& box) {
    const double matrix = particles.numRows * forceCouplingProduct(force, particles, box);
    const SchemeTraits& traits = traitsOf(scheme);
    return {matrix * workOf(traits, true, 0).matrices,
            matrix * workOf(traits, true, particles.size()).matrices};
}

/** @param box  of the grid (boxOfGrid()) */
void estimate(const MobilityForce& force, CustomRigidHIIntegrator::Scheme scheme,
              const HydrodynamicParticles& particles, const BoxVectors& box, GridChoice& choice) {
    const bool bySurfaces = force.getModel() == MobilityForce::RotnePragerYamakawa,
               inChannel = force.getBoundary() == MobilityForce::SlipChannel,
               confined = isConfined(force.getBoundary());
    set<int> bodies, multiblobs;
    int bodyRows = 0;
    for (int i = 0; i < particles.size(); i++)
        if (particles.body[i] < 0)
            bodyRows += 3;
        else {
            bodies.insert(particles.body[i]);
            if (!particles.hasTorque[i]) multiblobs.insert(particles.body[i]);
        }
    bodyRows += 6 * bodies.size();
    const bool hasMomenta = traitsOf(scheme).kind == SchemeKind::FluidThermostat;
    // Spheres drift only beside walls and with lubrication. Lubrication iterates.
    const bool lubricated = hasLubrication(force);
    const SchemeWork work =
        workOf(traitsOf(scheme), !bySurfaces,
               (inChannel || confined || lubricated ? bodies : multiblobs).size());

    // Matrices. A channel has an image of every particle.
    const double rows = particles.numRows;
    choice.matrixSeconds =
        work.matrices * (secondsOfMatrix(particles, box, confined, inChannel ? 2 : 1) +
                         1e-9 * timeOfFactor * pow(rows, 3)) +
        (hasMomenta ? 1e-9 * timeOfEigensystem * pow(bodyRows, 3) : 0);

    // A grid. Each digit takes an iteration, or more if the particles are crowded. Overlapping
    // particles fill less than the sum of their volumes.
    const double volumeFraction =
        min(0.2, volumeOf(particles) / (planeArea(box) * box[2][2] / (inChannel ? 2 : 1)));
    const double iterations = -log10(force.getSolverTolerance()) * (1 + 7 * sqrt(volumeFraction)),
                 ofSolve = multiblobs.empty() && !lubricated ? 1 : 1 + iterations;
    const double product = bySurfaces ? surfacesProduct(force, particles, box)
                                      : forceCouplingProduct(force, particles, box);
    // In units of a product. A field by surfaces must also find pairs and draw their noise. With
    // lubrication, noise takes as many products as the iterations of a root.
    const double ofField = lubricated   ? iterations
                           : bySurfaces ? 3
                                        : 1,
                 ofPlace = bySurfaces ? 1.5 : 0;
    choice.gridSeconds =
        product *
        (hasMomenta
             ? ofPlace + (multiblobs.empty() ? 2 * iterations : iterations * iterations)
             : ofPlace + work.solves * ofSolve + work.roots * iterations + work.fields * ofField);
}

}  // namespace

string GridChoice::text() const {
    if (!isEstimated() || (isSmall && !onGrid)) return costOfMatrices;
    return string("chosen by Auto: a step is estimated to take ") +
           RigidHIPlugin::text(matrixSeconds, 2) + " s with matrices and " +
           RigidHIPlugin::text(gridSeconds, 2) + " s on a grid, on one thread" +
           (costOfMatrices.empty() ? "" : "; " + costOfMatrices);
}

namespace {

bool isKnown(const BoxVectors& box) {
    const BoxVectors none = {},
                     unset = {OpenMM::Vec3(2, 0, 0), OpenMM::Vec3(0, 2, 0), OpenMM::Vec3(0, 0, 2)};
    return box != none && box != unset;
}

bool isTooDiluteForGrid(const HydrodynamicParticles& particles, const BoxVectors& box) {
    return volumeOf(particles) < leastVolumeFraction * planeArea(box) * box[2][2];
}

/** Whether lubrication may use iterative products for this scheme (GroupBuilder). */
bool lubricationMayIterate(const MobilityForce& force, CustomRigidHIIntegrator::Scheme scheme) {
    return traitsOf(scheme).takesIterations() && force.getMinimumGap() == 0;
}

GridChoice choose(const MobilityForce& force, CustomRigidHIIntegrator::Scheme scheme,
                  const BoxVectors& defaultBox, const HydrodynamicParticles& particles) {
    GridChoice choice;
    if (!traitsOf(force.getModel()).hasGrid(force.getBoundary())) return choice;
    if (!hasLatticeSums(force)) {
        choice.onGrid =
            force.getSolver() == MobilityForce::MatrixFree ||
            (force.getSolver() == MobilityForce::Auto && particles.numRows > fewRowsOfGrid);
        // Matrices of few rows that might be iterations are Auto's own choice.
        if (hasLubrication(force) && isKnown(defaultBox) &&
            (choice.onGrid || !lubricationMayIterate(force, scheme)))
            choice.columns =
                secondsOfColumns(force, scheme, particles, boxOfGrid(force, particles, defaultBox));
        return choice;
    }
    choice.onGrid = force.getSolver() == MobilityForce::MatrixFree;
    // On a grid lubrication has another reach, so StokesianDynamics uses a grid only on request.
    if (force.getSolver() != MobilityForce::Auto ||
        force.getModel() == MobilityForce::StokesianDynamics)
        return choice;
    const bool isTriclinic =
        defaultBox[1][0] != 0 || defaultBox[2][0] != 0 || defaultBox[2][1] != 0;
    const int rows =
        (force.getBoundary() == MobilityForce::SlipChannel ? 2 : 1) * particles.numRows;
    if ((isTriclinic && force.getBoundary() != MobilityForce::Periodic) ||
        (force.getModel() == MobilityForce::RotnePragerYamakawa &&
         (int)kindsOf(particles).size() > RotnePragerYamakawaGrid::mostRadii))
        return choice;
    if (hasLubrication(force) && !lubricationMayIterate(force, scheme)) return choice;
    choice.isSmall = rows <= fewRows;
    if (choice.isSmall && (force.getGridSpacing() > 0 || !isKnown(defaultBox) ||
                           isTooDiluteForGrid(particles, boxOfGrid(force, particles, defaultBox))))
        return choice;
    choice.onGrid = true;
    if (rows > mostLatticeRows || force.getGridSpacing() > 0) return choice;
    if (!isKnown(defaultBox)) return choice;
    estimate(force, scheme, particles, boxOfGrid(force, particles, defaultBox), choice);
    choice.onGrid = choice.isSmall
                        ? choice.matrixSeconds > max(shortStep, timesOfGrid * choice.gridSeconds)
                        : choice.gridSeconds < choice.matrixSeconds;
    return choice;
}

}  // namespace

GridChoice chooseGrid(const MobilityForce& force, CustomRigidHIIntegrator::Scheme scheme,
                      const BoxVectors& defaultBox, const HydrodynamicParticles& particles) {
    GridChoice choice = choose(force, scheme, defaultBox, particles);
    if (!choice.onGrid && isConfined(force.getBoundary()) && isKnown(defaultBox)) {
        const double rows = particles.numRows;
        choice.costOfMatrices = "each matrix has " + to_string(particles.numRows) + " rows, " +
                                RigidHIPlugin::text(8e-6 * rows * rows, 2) +
                                " MB, and is estimated to take ";
        const bool bySums = hasLatticeSums(force);
        choice.costOfMatrices += RigidHIPlugin::text(
            bySums ? secondsOfMatrix(particles, defaultBox, true)
                   : rows * forceCouplingProduct(force, particles,
                                                 boxOfGrid(force, particles, defaultBox)),
            2);
        choice.costOfMatrices +=
            bySums ? " s on one thread" : " s on one thread, by a product on the grid for each row";
    }
    return choice;
}

}  // namespace RigidHIPlugin

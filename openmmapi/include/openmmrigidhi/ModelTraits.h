#ifndef OPENMMRIGIDHI_MODEL_TRAITS_H_
#define OPENMMRIGIDHI_MODEL_TRAITS_H_

#include <cstddef>
#include <string>

#include "openmmrigidhi/MobilityForce.h"
#include "openmmrigidhi/internal/ModelList.h"

namespace RigidHIPlugin {

/** What bounds the fluid on one side. A new kind needs its case in the formulas of walls. */
enum class WallKind { NoWall, NoSlip, Slip };

/** The properties of a boundary of the fluid. ModelList.h explains each member. */
struct BoundaryTraits {
    MobilityForce::Boundary boundary;
    const char* name;
    bool isPeriodic;
    int wallAxis;
    WallKind lowWall, highWall;
    int numWalls;  // 1: the fluid is above setWallHeight(); 2: it is between setChannelWalls()
    const char *walls, *description;

    constexpr bool hasWalls() const { return numWalls > 0; }
    /** Whether the only wall is below the fluid, which is at rest on it. */
    constexpr bool isAboveNoSlipWall() const {
        return lowWall == WallKind::NoSlip && highWall == WallKind::NoWall;
    }
    /** Whether this axis crosses walls. */
    constexpr bool isAcross(int axis) const { return hasWalls() && axis == wallAxis; }
    /** The numbers and the names of both axes along the walls, for messages. */
    constexpr const char* axesAlongWalls() const {
        return wallAxis == 0 ? "1 and 2" : wallAxis == 1 ? "0 and 2" : "0 and 1";
    }
    constexpr const char* namesAlongWalls() const {
        return wallAxis == 0 ? "y and z" : wallAxis == 1 ? "x and z" : "x and y";
    }
    /** Whether the fluid is the same everywhere, without walls and images. */
    constexpr bool isUniform() const { return !isPeriodic && !hasWalls(); }
};

/** All boundaries, in the order of their numbers. */
constexpr BoundaryTraits boundaryTable[] = {
#define RIGIDHI_ROW(name, isPeriodic, wallAxis, lowWall, highWall, walls, description)   \
    {MobilityForce::name,                                                                \
     #name,                                                                              \
     isPeriodic,                                                                         \
     wallAxis,                                                                           \
     WallKind::lowWall,                                                                  \
     WallKind::highWall,                                                                 \
     (WallKind::lowWall != WallKind::NoWall) + (WallKind::highWall != WallKind::NoWall), \
     walls,                                                                              \
     description},
    RIGIDHI_BOUNDARIES(RIGIDHI_ROW)
#undef RIGIDHI_ROW
};

/** The properties of a model. ModelList.h explains each member. */
struct ModelTraits {
    MobilityForce::Model model;
    const char* name;
    unsigned boundaries, grids;  // a bit for each boundary
    bool takesOverlap, takesMultiblobs, couplesBodies;
    const char *interactions, *cost, *description;

    constexpr bool hasBoundary(MobilityForce::Boundary boundary) const {
        return boundaries >> boundary & 1;
    }
    /** Whether a grid can take the place of matrices. */
    constexpr bool hasGrid(MobilityForce::Boundary boundary) const { return grids >> boundary & 1; }
};

/** The name of each boundary as a set of one, so that the list can write sets of several. */
namespace boundarySets {

#define RIGIDHI_ROW(name, ...) constexpr unsigned name = 1u << MobilityForce::name;
RIGIDHI_BOUNDARIES(RIGIDHI_ROW)
#undef RIGIDHI_ROW

/** All models, in the order of their numbers. */
constexpr ModelTraits modelTable[] = {
#define RIGIDHI_ROW(name, boundaries, grids, takesOverlap, takesMultiblobs, couplesBodies, \
                    interactions, cost, description)                                       \
    {MobilityForce::name, #name,         boundaries,   grids, takesOverlap,                \
     takesMultiblobs,     couplesBodies, interactions, cost,  description},
    RIGIDHI_MODELS(RIGIDHI_ROW)
#undef RIGIDHI_ROW
};

}  // namespace boundarySets

using boundarySets::modelTable;

constexpr const BoundaryTraits& traitsOf(MobilityForce::Boundary boundary) {
    return boundaryTable[boundary];
}
constexpr const ModelTraits& traitsOf(MobilityForce::Model model) { return modelTable[model]; }

/** Whether spheres of a model can have lubrication. They can if they feel each other. */
constexpr bool mayHaveLubrication(MobilityForce::Model model) {
    return traitsOf(model).couplesBodies;
}
/** Whether spheres have lubrication with this model and setting: Auto is on with StokesianDynamics.
 */
constexpr bool hasLubrication(MobilityForce::Model model, MobilityForce::Lubrication lubrication) {
    return lubrication == MobilityForce::On ? mayHaveLubrication(model)
                                            : lubrication == MobilityForce::AutoLubrication &&
                                                  model == MobilityForce::StokesianDynamics;
}
inline bool hasLubrication(const MobilityForce& force) {
    return hasLubrication(force.getModel(), force.getLubrication());
}

/** Whether a table has a row of this number. */
template <class Row, size_t count>
constexpr bool hasRow(const Row (&)[count], int number) {
    return number >= 0 && number < (int)count;
}
/** The name of an enumerator; empty for a value that is none. */
template <class Row, size_t count>
const char* nameIn(const Row (&table)[count], int number) {
    return hasRow(table, number) ? table[number].name : "";
}
/** The names of the rows for which `isChosen` is true, with a separator between them. */
template <class Row, size_t count, class Choice>
std::string namesIn(const Row (&table)[count], const char* separator, const Choice& isChosen) {
    std::string names;
    for (const Row& row : table)
        if (isChosen(row)) names += (names.empty() ? "" : separator) + std::string(row.name);
    return names;
}
/** All names, separated by commas. */
template <class Row, size_t count>
std::string listOf(const Row (&table)[count]) {
    return namesIn(table, ", ", [](const Row&) { return true; });
}

}  // namespace RigidHIPlugin

#endif

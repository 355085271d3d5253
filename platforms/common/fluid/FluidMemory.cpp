#include "fluid/FluidMemory.h"

#include <openmm/OpenMMException.h>

#include "fluid/FlowReader.h"

using namespace Eigen;
using namespace std;

namespace RigidHIPlugin {

namespace {

/** The scheme without momenta that made a saved last step; null without such a scheme. */
const SchemeTraits* schemeOfLastStep(const SchemeMemory& saved) {
    if (saved.groups.empty()) return nullptr;
    for (const SchemeTraits& traits : schemeTable)
        if (traits.isOverdamped() && saved.scheme == traits.name) return &traits;
    return nullptr;
}

}  // namespace

void FluidMemory::restore() {
    for (const auto& group : fluid.groups) group->brownian->restoreMemory();
}

void FluidMemory::forget() {
    for (const auto& group : fluid.groups) group->brownian->forgetMemory();
}

SchemeMemory FluidMemory::getOfScheme() const {
    SchemeMemory saved;
    for (const auto& group : fluid.groups) {
        vector<MatrixXd> own;
        for (MatrixXd* vectors : group->brownian->getMemory()) own.push_back(*vectors);
        if (!own.empty()) saved.groups.push_back(own);
    }
    if (!saved.groups.empty()) saved.scheme = traitsOf(fluid.groups[0]->brownian->getScheme()).name;
    return saved;
}

void FluidMemory::checkOfScheme(const SchemeMemory& saved,
                                CustomRigidHIIntegrator::Scheme scheme) const {
    const SchemeTraits& traits = traitsOf(scheme);
    if (saved.groups.empty() || saved.scheme != traits.name) return;
    const auto& groups = fluid.groups;
    bool fits = traits.isOverdamped() && saved.groups.size() == groups.size();
    const size_t count = fits ? overdampedScheme(scheme).make()->memory().size() : 0;
    for (size_t g = 0; fits && g < groups.size(); g++) {
        fits = saved.groups[g].size() == count;
        for (const MatrixXd& vectors : saved.groups[g])
            fits =
                fits && (vectors.size() == 0 ||
                         (vectors.rows() == groups[g]->bodies.getNumRows() && vectors.allFinite()));
    }
    if (!fits)
        throw OpenMM::OpenMMException(
            "CustomRigidHIIntegrator: the saved state's memory of scheme " + saved.scheme +
            " is damaged, or belongs to other bodies; load the state into an integrator with the "
            "same bodies and groups, or use another state");
}

void FluidMemory::setOfScheme(const SchemeMemory& saved, CustomRigidHIIntegrator::Scheme scheme) {
    checkOfScheme(saved, scheme);
    forget();
    if (saved.groups.empty() || saved.scheme != traitsOf(scheme).name) return;
    for (size_t g = 0; g < fluid.groups.size(); g++) {
        BrownianGroup& group = *fluid.groups[g]->brownian;
        group.begin(scheme);
        const auto memory = group.getMemory();
        for (size_t i = 0; i < memory.size(); i++) *memory[i] = saved.groups[g][i];
    }
}

void FluidMemory::continueFrom(const FluidMemory& before) {
    if (fluid.groups.empty() || fluid.groups.size() != before.fluid.groups.size()) return;
    // Elements have another order if other bodies are held.
    if (!fluid.settings.holdsAs(before.fluid.settings)) return;
    setOfScheme(before.getOfScheme(), before.fluid.groups[0]->brownian->getScheme());
}

SchemeMemory FluidMemory::getLastStep() const {
    SchemeMemory saved;
    for (const auto& group : fluid.groups) {
        const LastStep& last = group->brownian->getLastStep();
        if (!last.isKnown) return {};
        saved.groups.push_back(numbersOf(last));
    }
    if (!saved.groups.empty())
        saved.scheme = traitsOf(fluid.groups[0]->brownian->getLastStep().scheme).name;
    return saved;
}

void FluidMemory::checkLastStep(const SchemeMemory& saved) const {
    const SchemeTraits* const scheme = schemeOfLastStep(saved);
    if (!scheme) return;
    const auto& groups = fluid.groups;
    bool fits = saved.groups.size() == groups.size();
    for (size_t g = 0; fits && g < groups.size(); g++)
        fits = areOfAStep(saved.groups[g], overdampedScheme(scheme->scheme),
                          groups[g]->poses.size(), groups[g]->bodies.getNumRows());
    if (!fits)
        throw OpenMM::OpenMMException(
            "CustomRigidHIIntegrator: the saved state's last step of scheme " + saved.scheme +
            " is damaged, or belongs to other bodies; load the state into an integrator with the "
            "same bodies and groups, or use another state");
}

void FluidMemory::setLastStep(const SchemeMemory& saved) {
    checkLastStep(saved);
    flowReader.forget();
    for (const auto& group : fluid.groups) group->brownian->forgetLastStep();
    const SchemeTraits* const scheme = schemeOfLastStep(saved);
    if (!scheme) return;
    for (size_t g = 0; g < fluid.groups.size(); g++) {
        BrownianGroup& group = *fluid.groups[g]->brownian;
        const LastStep last = stepOf(saved.groups[g], scheme->scheme);
        // With other motors the step cannot be repeated.
        if (last.step.motorRates.size() == group.getMotorRates().size()) group.setLastStep(last);
    }
}

/** Call action(rows in the group, rows in the vector of all bodies and then all free particles). */
template <class Action>
static void forElements(const FluidContents& fluid, const FluidGroup& group, const Action& action) {
    const auto& elements = group.bodies.getElements();
    const int numBodyRows = 6 * fluid.groupOfBody.size();
    for (size_t e = 0; e < elements.size(); e++)
        action(group.bodies.firstRow(e),
               elements[e].isFree() ? numBodyRows + 3 * group.members.freeIndex[e]
                                    : 6 * elements[e].body,
               elements[e].numRows());
}

static int numRowsOfAll(const FluidContents& fluid) {
    return 6 * fluid.groupOfBody.size() + 3 * fluid.groupOfFree.size();
}

/**
 * The holds are in the order of bodies and free particles, which does not depend on what is held.
 */
SchemeMemory FluidMemory::getHolds() const {
    fluid.findHolds();
    MatrixXd all = MatrixXd::Zero(numRowsOfAll(fluid), 1);
    bool any = false;
    for (const auto& group : fluid.groups) {
        const MatrixXd* const holds = group->brownian->getHolds();
        if (!holds) continue;
        any = true;
        forElements(fluid, *group, [&](int row, int rowOfAll, int count) {
            all.middleRows(rowOfAll, count) = holds->middleRows(row, count);
        });
    }
    if (!any) return {};
    return {traitsOf(fluid.groups[0]->brownian->getScheme()).name, {{all}}};
}

void FluidMemory::checkHolds(const SchemeMemory& saved) const {
    if (saved.groups.empty()) return;
    const bool fits = saved.groups.size() == 1 && saved.groups[0].size() == 1 &&
                      saved.groups[0][0].rows() == numRowsOfAll(fluid) &&
                      saved.groups[0][0].cols() == 1 && saved.groups[0][0].allFinite();
    if (!fits)
        throw OpenMM::OpenMMException(
            "CustomRigidHIIntegrator: the saved state's record of what held bodies in the last "
            "step is damaged, or belongs to other bodies; load the state into an integrator with "
            "the same bodies, or use another state");
}

void FluidMemory::setHolds(const SchemeMemory& saved) {
    checkHolds(saved);
    for (const auto& group : fluid.groups) {
        group->brownian->forgetHolds();
        if (group->holds) group->holds->forget();
        if (saved.groups.empty() || !group->bodies.getFreeMotion().any()) continue;
        MatrixXd holds(group->bodies.getNumRows(), 1);
        forElements(fluid, *group, [&](int row, int rowOfAll, int count) {
            holds.middleRows(row, count) = saved.groups[0][0].middleRows(rowOfAll, count);
        });
        group->brownian->setHolds(holds);
    }
}

}  // namespace RigidHIPlugin

// Fluid: steps without momenta.

#include <openmm/OpenMMException.h>

#include <functional>

#include "fluid/Fluid.h"
#include "linearalgebra/OneBlasThread.h"

using namespace Eigen;
using namespace std;

namespace RigidHIPlugin {

void Fluid::beginOverdamped(CustomRigidHIIntegrator::Scheme scheme) {
    schemeOfSteps = scheme;
    for (auto& group : groups) group->brownian->begin(scheme);
}

void Fluid::endOverdamped() {
    for (auto& group : groups) group->brownian->end();
}

int Fluid::nextStage() const {
    int next = overdampedScheme(schemeOfSteps).numStages();
    for (const auto& group : groups) next = min(next, group->brownian->getStage());
    return next;
}

LoopResult Fluid::runStage(int stage, const StepSettings& stepSettings, BodySet& bodies,
                           const FreeParticles& freeParticles, vector<OpenMM::Vec3>& positions) {
    const OneBlasThread single;
    flowReader.forget();
    double operations = 0;
    for (auto& group : groups) {
        group->brownian->prepare(stepSettings);
        group->objection.clear();
        if (group->brownian->getStage() == stage) operations += group->brownian->getOperations();
    }
    const BrownianGroup::Surroundings around = {driven, box, hasOneFlow()};
    const auto task = [&](int i) {
        FluidGroup& group = *groups[i];
        const bool isRun =
            group.brownian->runStage(stage, stepSettings, around, bodies, freeParticles, positions);
        if (isRun && group.brownian->getOutcome().isFinite)
            group.objection = objection(group, bodies, positions);
    };
    if (groups.size() > 1 && operations > worthThreads)
        loops.forTasks(groups.size(), cref(task));
    else
        for (size_t i = 0; i < groups.size(); i++) task(i);
    LoopResult result;
    for (const auto& group : groups) {
        const BrownianGroup::Outcome& outcome = group->brownian->getOutcome();
        result.randomNumbers += outcome.randomNumbers;
        result.finite = result.finite && outcome.isFinite;
        numSquareRoots += outcome.squareRoots;
        numIterations += outcome.iterations;
    }
    return result;
}

Fluid::Rejections Fluid::takeBackRejected(const BodySet::Snapshot& bodiesAtStart,
                                          const FreeParticles::Snapshot& freeAtStart,
                                          BodySet& bodies, FreeParticles& freeParticles,
                                          vector<OpenMM::Vec3>& positions) {
    Rejections result;
    for (auto& group : groups) {
        if (group->objection.empty()) continue;
        const auto& elements = group->bodies.getElements();
        for (size_t e = 0; e < elements.size(); e++)
            if (elements[e].isFree())
                freeParticles.restore(freeAtStart, group->members.freeIndex[e], positions);
            else
                bodies.restore(bodiesAtStart, elements[e].body);
        group->brownian->reject();
        result.number++;
        if ((int)group->brownian->getAttempt() > result.attempts) {
            result.attempts = group->brownian->getAttempt();
            result.objection = group->objection;
        }
        group->objection.clear();
    }
    return result;
}

void Fluid::showStage(int stage, BodySet& bodies, vector<OpenMM::Vec3>& positions) const {
    for (const auto& group : groups) group->brownian->showStage(stage, bodies, positions);
}

void Fluid::restoreMemory() {
    for (auto& group : groups) group->brownian->restoreMemory();
}

void Fluid::forgetMemory() {
    for (auto& group : groups) group->brownian->forgetMemory();
}

SchemeMemory Fluid::getMemory() const {
    SchemeMemory saved;
    for (const auto& group : groups) {
        vector<MatrixXd> own;
        for (MatrixXd* vectors : group->brownian->getMemory()) own.push_back(*vectors);
        if (!own.empty()) saved.groups.push_back(own);
    }
    if (!saved.groups.empty()) saved.scheme = traitsOf(schemeOfSteps).name;
    return saved;
}

void Fluid::checkMemory(const SchemeMemory& saved, CustomRigidHIIntegrator::Scheme scheme) const {
    const SchemeTraits& traits = traitsOf(scheme);
    if (saved.groups.empty() || saved.scheme != traits.name) return;
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

void Fluid::setMemory(const SchemeMemory& saved, CustomRigidHIIntegrator::Scheme scheme) {
    checkMemory(saved, scheme);
    forgetMemory();
    if (saved.groups.empty() || saved.scheme != traitsOf(scheme).name) return;
    beginOverdamped(scheme);
    for (size_t g = 0; g < groups.size(); g++) {
        const auto memory = groups[g]->brownian->getMemory();
        for (size_t i = 0; i < memory.size(); i++) *memory[i] = saved.groups[g][i];
    }
}

SchemeMemory Fluid::getLastStep() const {
    SchemeMemory saved;
    for (const auto& group : groups) {
        const LastStep& last = group->brownian->getLastStep();
        if (!last.isKnown) return {};
        saved.groups.push_back(numbersOf(last));
    }
    if (!saved.groups.empty())
        saved.scheme = traitsOf(groups[0]->brownian->getLastStep().scheme).name;
    return saved;
}

namespace {

/** The scheme without momenta that made a saved last step; null: there is none. */
const SchemeTraits* schemeOfLastStep(const SchemeMemory& saved) {
    if (saved.groups.empty()) return nullptr;
    for (const SchemeTraits& traits : schemeTable)
        if (traits.isOverdamped() && saved.scheme == traits.name) return &traits;
    return nullptr;
}

}  // namespace

void Fluid::checkLastStep(const SchemeMemory& saved) const {
    const SchemeTraits* const scheme = schemeOfLastStep(saved);
    if (!scheme) return;
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

void Fluid::setLastStep(const SchemeMemory& saved) {
    checkLastStep(saved);
    flowReader.forget();
    for (auto& group : groups) group->brownian->forgetLastStep();
    const SchemeTraits* const scheme = schemeOfLastStep(saved);
    if (!scheme) return;
    for (size_t g = 0; g < groups.size(); g++)
        groups[g]->brownian->setLastStep(stepOf(saved.groups[g], scheme->scheme));
}

}  // namespace RigidHIPlugin

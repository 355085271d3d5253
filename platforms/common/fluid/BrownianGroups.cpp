#include "fluid/BrownianGroups.h"

#include <algorithm>
#include <functional>

#include "fluid/FlowReader.h"
#include "fluid/FluidChecks.h"
#include "linearalgebra/OneBlasThread.h"

using namespace std;

namespace RigidHIPlugin {

void BrownianGroups::begin(CustomRigidHIIntegrator::Scheme wanted) {
    scheme = wanted;
    for (const auto& group : fluid.groups) group->brownian->begin(scheme);
}

void BrownianGroups::end() {
    for (const auto& group : fluid.groups) {
        group->brownian->end();
        if (group->holds) group->holds->forget();
    }
}

int BrownianGroups::nextStage() const {
    int next = overdampedScheme(scheme).numStages();
    for (const auto& group : fluid.groups) next = min(next, group->brownian->getStage());
    return next;
}

LoopResult BrownianGroups::runStage(int stage, const StepSettings& settings,
                                    const Eigen::MatrixXd* prescribed, BodySet& bodies,
                                    const FreeParticles& freeParticles,
                                    vector<OpenMM::Vec3>& positions) {
    const OneBlasThread single;
    flowReader.forget();
    double operations = 0;
    for (const auto& group : fluid.groups) {
        group->brownian->prepare(settings);
        group->objection.clear();
        if (group->brownian->getStage() == stage) operations += group->brownian->getOperations();
    }
    const BrownianGroup::Surroundings around = {fluid.getFlow(), fluid.box, fluid.remembersSteps(),
                                                prescribed};
    const auto task = [&](int i) {
        FluidGroup& group = *fluid.groups[i];
        ran[i] =
            group.brownian->runStage(stage, settings, around, bodies, freeParticles, positions);
        if (ran[i] && !fluid.userFlow.isSheared()) judge(i, bodies, positions);
    };
    ran.assign(fluid.groups.size(), false);
    fluid.forGroups(fluid.groups.size(), operations, cref(task));
    LoopResult result;
    for (const auto& group : fluid.groups) {
        const BrownianGroup::Outcome& outcome = group->brownian->getOutcome();
        result.randomNumbers += outcome.randomNumbers;
        result.squareRoots += outcome.squareRoots;
        result.iterations += outcome.iterations;
        result.finite = result.finite && outcome.isFinite;
    }
    return result;
}

void BrownianGroups::judge(int g, const BodySet& bodies, const vector<OpenMM::Vec3>& positions) {
    FluidGroup& group = *fluid.groups[g];
    if (group.brownian->getOutcome().isFinite)
        group.objection = group.objectionTo(bodies, positions);
}

void BrownianGroups::judgeInNextBox(const BodySet& bodies, const vector<OpenMM::Vec3>& positions) {
    const OneBlasThread single;
    for (size_t g = 0; g < fluid.groups.size(); g++)
        if (ran[g]) judge(g, bodies, positions);
}

BrownianGroups::Rejections BrownianGroups::takeBackRejected(
    const BodySet::Snapshot& bodiesAtStart, const FreeParticles::Snapshot& freeAtStart,
    BodySet& bodies, FreeParticles& freeParticles, vector<OpenMM::Vec3>& positions) {
    Rejections result;
    for (const auto& group : fluid.groups) {
        if (group->objection.empty()) continue;
        const string ofMotion = group->objectionToWhollyFixed(bodies, positions);
        if (!ofMotion.empty()) refusePrescribedMotion(ofMotion);
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

void BrownianGroups::showStage(int stage, BodySet& bodies, vector<OpenMM::Vec3>& positions) const {
    for (const auto& group : fluid.groups) group->brownian->showStage(stage, bodies, positions);
}

}  // namespace RigidHIPlugin

#ifndef RIGIDHI_BROWNIAN_GROUPS_H_
#define RIGIDHI_BROWNIAN_GROUPS_H_

#include <string>
#include <vector>

#include "fluid/FluidContents.h"

namespace RigidHIPlugin {

class FlowReader;

/**
 * Steps without momenta of all groups; BrownianGroup has the steps of one group. Groups that redo a
 * step are at earlier stages than others.
 */
class BrownianGroups {
public:
    /** @param flowReader  forgets its answer when a stage changes poses */
    BrownianGroups(const FluidContents& fluid, FlowReader& flowReader)
        : fluid(fluid), flowReader(flowReader) {}
    /** Begin a step: every group is at its start, for its first attempt. */
    void begin(CustomRigidHIIntegrator::Scheme scheme);
    /**
     * End the step: its record becomes the last step. A step that fails leaves the last step as it
     * was.
     */
    void end();
    /**
     * The next stage, which is earlier if groups redo the step. It is the scheme's number of stages
     * if no stage is left.
     */
    int nextStage() const;
    /**
     * Run a stage of the step for the groups whose next stage it is. The stage begins at the
     * present poses of bodies and free particles, with the forces last gathered if the stage needs
     * any. It ends where the next stage needs forces, or at the end of the step. Groups that are
     * past this stage return to the poses that they have reached.
     *
     * @param prescribed  velocities of the stage (BodyMotions::evaluate()); null: none
     */
    LoopResult runStage(int stage, const StepSettings& settings, const Eigen::MatrixXd* prescribed,
                        BodySet& bodies, const FreeParticles& freeParticles,
                        std::vector<OpenMM::Vec3>& positions);
    /**
     * In a sheared fluid, check whether the model has a mobility at the poses to which the last
     * stage led. Call this in the box of the time to which the stage led. In other fluids
     * runStage() checks this.
     */
    void judgeInNextBox(const BodySet& bodies, const std::vector<OpenMM::Vec3>& positions);
    struct Rejections {
        int number = 0;         // of groups
        int attempts = 0;       // largest number in a row of one group
        std::string objection;  // the reason of the first group with this number
    };
    /**
     * Take groups that the last stage led to poses without a mobility back to the start of the step
     * (poses and forces), each by itself, for their next attempt.
     *
     * @throws OpenMMException where prescribed motion led there by itself
     */
    Rejections takeBackRejected(const BodySet::Snapshot& bodiesAtStart,
                                const FreeParticles::Snapshot& freeAtStart, BodySet& bodies,
                                FreeParticles& freeParticles, std::vector<OpenMM::Vec3>& positions);
    /**
     * Put groups that are past this stage back to the poses where its forces were evaluated, during
     * the evaluation of forces for the other groups.
     */
    void showStage(int stage, BodySet& bodies, std::vector<OpenMM::Vec3>& positions) const;

private:
    void judge(int group, const BodySet& bodies, const std::vector<OpenMM::Vec3>& positions);
    const FluidContents& fluid;
    FlowReader& flowReader;
    CustomRigidHIIntegrator::Scheme scheme = CustomRigidHIIntegrator::EulerMaruyama;
    std::vector<char> ran;  // the groups that ran the last stage
};

}  // namespace RigidHIPlugin

#endif

#ifndef RIGIDHI_BROWNIAN_GROUPS_H_
#define RIGIDHI_BROWNIAN_GROUPS_H_

#include <string>
#include <vector>

#include "fluid/FluidContents.h"

namespace RigidHIPlugin {

class FlowReader;

/**
 * Steps without momenta of all groups (BrownianGroup has those of one). Groups that are redone are
 * at earlier stages than others.
 */
class BrownianGroups {
public:
    /** @param flowReader  forgets its answer when a stage changes poses */
    BrownianGroups(const FluidContents& fluid, FlowReader& flowReader)
        : fluid(fluid), flowReader(flowReader) {}
    /** Begin a step: every group is at its start, for its first attempt. */
    void begin(CustomRigidHIIntegrator::Scheme scheme);
    /** End it: what was recorded of the step becomes the last step. A step that fails leaves the
     * last step as it was. */
    void end();
    /**
     * The next stage. Groups that were redone make it an earlier one. It is the scheme's number of
     * stages if no stage is left.
     */
    int nextStage() const;
    /**
     * Run a stage of the step for the groups whose next stage it is. It begins at the present poses
     * of bodies and free particles, with the forces last gathered if the stage wants any. It ends
     * where the next stage wants forces, or at the end of the step. Groups that are further on
     * return to where they were.
     *
     * @param prescribed  velocities of the stage (BodyMotions::evaluate()); null: none
     */
    LoopResult runStage(int stage, const StepSettings& settings, const Eigen::MatrixXd* prescribed,
                        BodySet& bodies, const FreeParticles& freeParticles,
                        std::vector<OpenMM::Vec3>& positions);
    /**
     * In a fluid that is sheared: look whether the model has a mobility where the last stage led.
     * To be called in the box of the time that the stage led to. In other fluids runStage() does
     * it.
     */
    void judgeInNextBox(const BodySet& bodies, const std::vector<OpenMM::Vec3>& positions);
    struct Rejections {
        int number = 0;         // of groups
        int attempts = 0;       // largest number in a row of one group
        std::string objection;  // reason for the first group with so many
    };
    /**
     * Take groups that the last stage led to where the model has no mobility back to the start of
     * the step (poses and forces), each by itself, for their next attempt.
     *
     * @throws OpenMMException where prescribed motion led there by itself
     */
    Rejections takeBackRejected(const BodySet::Snapshot& bodiesAtStart,
                                const FreeParticles::Snapshot& freeAtStart, BodySet& bodies,
                                FreeParticles& freeParticles, std::vector<OpenMM::Vec3>& positions);
    /**
     * Move the groups that are further on to where their forces of a stage were evaluated, while
     * forces are evaluated for the other groups.
     */
    void showStage(int stage, BodySet& bodies, std::vector<OpenMM::Vec3>& positions) const;

private:
    void judge(int group, const BodySet& bodies, const std::vector<OpenMM::Vec3>& positions);
    const FluidContents& fluid;
    FlowReader& flowReader;
    CustomRigidHIIntegrator::Scheme scheme = CustomRigidHIIntegrator::EulerMaruyama;
    std::vector<char> ran;  // the groups whose stage the last one was
};

}  // namespace RigidHIPlugin

#endif

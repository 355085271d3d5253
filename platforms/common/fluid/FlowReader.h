#ifndef RIGIDHI_FLOW_READER_H_
#define RIGIDHI_FLOW_READER_H_

#include <array>
#include <memory>
#include <vector>

#include "fluid/FluidContents.h"

namespace RigidHIPlugin {

/**
 * The poses of bodies and free particles, and the forces and motions on them, for a user's question
 * about the flow of the fluid.
 */
struct FlowQuestion {
    const BodySet& bodies;
    const FreeParticles& freeParticles;
    const std::vector<OpenMM::Vec3>& positions;
    const std::vector<OpenMM::Vec3>& velocities;
    CustomRigidHIIntegrator::Scheme scheme;  // of the integrator at present
    const Eigen::MatrixXd* prescribed;       // velocities at present; null: none
    bool hasMomenta() const { return traitsOf(scheme).hasMomenta; }
};

/**
 * Reads the flow of the fluid. This is the flow of the last step, which the reader repeats from
 * recorded data on vectors of its own, or the flow of the present forces or (LangevinHI)
 * velocities.
 *
 * All bodies must share one fluid. The reader keeps the last answer until forget().
 */
class FlowReader {
public:
    explicit FlowReader(const FluidContents& fluid) : fluid(fluid), force(fluid.force) {}
    /** Poses, box or settings have changed. */
    void forget() { answer.reset(); }
    /**
     * Whether the last step without momenta led to the present poses of bodies and particles, in
     * the present box.
     */
    bool lastStepIsPresent(const BodySet& bodies, const std::vector<OpenMM::Vec3>& positions) const;
    /**
     * Whether lastStepIsPresent(), and a repetition of the last step leads to the same poses. If
     * so, answers give the flow of that step. If not, they give the flow of the forces last
     * gathered.
     */
    bool findLastStep(const BodySet& bodies, const std::vector<OpenMM::Vec3>& positions,
                      CustomRigidHIIntegrator::Scheme scheme);
    /**
     * Velocities of the fluid at points: of the last step, at the poses where its forces were
     * evaluated; or of the present forces or (LangevinHI) velocities.
     * @throws OpenMMException for several groups, FreeDraining, and points beyond walls
     */
    Velocities flowAt(const std::vector<OpenMM::Vec3>& points, const FlowQuestion& question);
    /**
     * The amplitudes of sin(k x_b) e_a and cos(k x_b) e_a of the same flow. @throws OpenMMException
     * as flowAt(), and for a boundary without such modes
     */
    std::array<double, 2> flowMode(int forceAxis, int waveAxis, int waveVectorIndex,
                                   const FlowQuestion& question);
    /** The amplitudes for the model's random field alone, for nu = 1; 0 without such a field. */
    std::array<double, 2> randomFlowMode(int forceAxis, int waveAxis, int waveVectorIndex,
                                         const FlowQuestion& question);
    /**
     * The mean of the same flow over the volume of the fluid. @throws OpenMMException as flowAt(),
     * and for a boundary whose fluid has no finite volume
     */
    OpenMM::Vec3 meanFlow(const FlowQuestion& question);
    OpenMM::Vec3 randomMeanFlow(const FlowQuestion& question);

private:
    /** The flow of a group: its sources, and the move that has its random field. */
    struct Answer {
        FlowOfStep made;
        std::unique_ptr<OverdampedMove> move;
        bool isOfLastStep = false;
        double randomFlow =
            0;  // the factor in this step of a random field of unit temperature and time
    };
    void replay(FluidGroup& group, Answer& result) const;
    void flowOfForces(FluidGroup& group, const FlowQuestion& question, Answer& result) const;
    void flowOfVelocities(FluidGroup& group, const FlowQuestion& question, Answer& result) const;
    template <class Add>
    void forSources(FluidGroup& group, Answer& of, const Add& add) const;
    FluidGroup& onlyGroup(const char* method) const;
    FluidGroup& groupWithWave(const char* method, int forceAxis, int waveAxis, int waveVectorIndex,
                              DrivenFlow& wave) const;
    FluidGroup& groupWithVolume(const char* method) const;
    Answer& find(FluidGroup& group, const FlowQuestion& question);

    const FluidContents& fluid;
    const MobilityForce& force;
    std::unique_ptr<Answer> answer;
};

}  // namespace RigidHIPlugin

#endif

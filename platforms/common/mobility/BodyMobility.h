#ifndef RIGIDHI_BODY_MOBILITY_H_
#define RIGIDHI_BODY_MOBILITY_H_

#include <Eigen/Core>
#include <functional>
#include <memory>
#include <vector>

#include "mobility/CholeskyFactor.h"
#include "mobility/CoincidenceCheck.h"
#include "mobility/MultiblobSolver.h"
#include "mobility/NullTwists.h"
#include "mobility/RigidMotion.h"

namespace RigidHIPlugin {

/**
 * The mobility of rigid bodies that feel each other, made from that of their particles: N = (K^T M^-1 K)^-1, where the rows
 * of K give the velocities of the particles from V and W of their body (Westwood 2022, eqs. 7 to 10).
 * A sphere carries force and torque, the blobs of a multiblob forces only.
 *
 * Rows: six a body (V, W about its origin; lab frame), then three a free particle, in the order of the elements.
 * Where all blobs of a body are on a line its mobility is the generalised inverse that NullTwists describes.
 * Own tensors enter by congruence: N = B N_model B^T, B = N_own^(1/2) N_alone^(-1/2), alone in unbounded fluid: at a wall a
 * body's own tensor then feels the wall as the model's does.
 */
class BodyMobility {
public:
    typedef std::function<std::unique_ptr<MobilityModel>(const HydrodynamicParticles&)> ModelFactory;
    /**
     * @param elements      what feels each other
     * @param makeModel     makes the model of given particles
     * @param mayBeConstant false: the tensor of a body that is alone in a uniform fluid is made anew at every pose too
     */
    BodyMobility(const std::vector<FluidElement>& elements, const ModelFactory& makeModel, bool mayBeConstant = true);

    const std::vector<FluidElement>& getElements() const { return motion.getElements(); }
    int getNumRows() const { return motion.getNumRows(); }
    int getNumParticleRows() const { return motion.getParticles().numRows; }
    int firstRow(int element) const { return motion.firstRow(element); }
    /** Whether the tensor is that of one body in a homogeneous fluid, known once for all in its own frame. */
    bool isConstantInBodyFrame() const { return constant; }
    /** Whether friction() is the matrix that costs less. */
    bool prefersFriction() const;
    /** The null vector of element's friction in its frame (unit length), if its blobs are on a line. */
    bool hasNullVector(int element) const { return nullTwists.has(element); }
    const Eigen::VectorXd& getNullVector_body(int element) const { return nullTwists.inBody(element); }

    /**
     * One pose an element; a free particle's q is not used. @throws what the model's at() throws, and for two particles of one radius at
     * one place
     *
     * @param nearby  these are a small displacement from accepted ones: near() of the model
     */
    void setPoses(const std::vector<Pose>& poses, bool nearby = false);
    /** The vectors of the periodic box, from the next poses on; zeros: there is none. */
    void setBox(const BoxVectors& vectors) { box = vectors; }
    /** MobilityModel::objection() and mayObject() for bodies. */
    std::string objection(const std::vector<Pose>& poses) const;
    bool mayObject() const { return model && model->mayObject(); }
    /** MobilityModel::acceptsNearby() for bodies. */
    bool acceptsNearby(const std::vector<Pose>& poses) const;
    /** The rotation of an element at the poses set last. */
    const Eigen::Matrix3d& getTurn(int element) const { return turns[element]; }
    /** N at the poses set last, computed when first asked for. */
    const Eigen::MatrixXd& mobility();
    /** Its (pseudo-)inverse, likewise. */
    const Eigen::MatrixXd& friction();
    /** twists = N wrenches; columns are cases of their own. Multiplies by N if that is known, else as applyMatrixFree(). */
    void apply(const Eigen::MatrixXd& wrenches, Eigen::MatrixXd& twists);
    /**
     * twists = N wrenches without any matrix over all bodies: products with the particles' mobility, and MultiblobSolver where
     * there are multiblobs.
     *
     * @param tolerance            relative, of the latter
     * @param toleranceOfProducts  of the former, as of MobilityAt::applyFor(); 0: exact
     */
    void applyMatrixFree(const Eigen::MatrixXd& wrenches, double tolerance, Eigen::MatrixXd& twists,
                         double toleranceOfProducts = 0);
    /**
     * velocities = M forces of the elements' particles at the poses set last, as if each were free: three rows for each particle of the
     * System, of which those of these particles are read and written. Spheres take no torque; own tensors have no part in it.
     */
    void applyToParticles(const Eigen::VectorXd& forces, Eigen::VectorXd& velocities);
    /** Whether applyMatrixFree() is possible: the model has products. */
    bool canApplyMatrixFree() const { return model && model->hasProducts(); }
    /** Whether that has no iterations, and so no error: spheres. Then apply() does the same. */
    bool multipliesWithoutIterations() const { return motion.isIdentity() && canApplyMatrixFree(); }
    /** Whether mobilityByIterations() takes less time than mobility(). By numbers of rows only, so that it is so on any machine. */
    bool isWorthIterations() const {
        return canApplyMatrixFree() && !motion.isIdentity() &&
               getNumParticleRows() > model->rowsWorthIterations() * getNumRows();
    }
    /** N by applyMatrixFree() to its columns, to a relative tolerance, and symmetric. */
    Eigen::MatrixXd mobilityByIterations(double tolerance);

    /** Whether there is one element only in a fluid that is the same everywhere. */
    bool isAloneInUniformFluid() const { return aloneInUniformFluid; }
    /**
     * Whether div N = 0 at all poses: spheres about their centres do not feel how they are turned, so the divergence is that of the
     * particles' mobility.
     */
    bool isDivergenceFree() const {
        return motion.isIdentity() && !hasOwnTensors && model && model->isDivergenceFree();
    }
    /** The solver behind applyMatrixFree() at the poses set last. */
    MultiblobSolver& getMultiblobSolver();
    /** Longest distance between points of the element's particles, nm: what finite differences scale translations with. */
    double length(int element) const;

    /** The tolerance that the user has set, for messages of iterations, which may be left a part of it. 0: not known. */
    double wantedTolerance = 0;
    /** Matrices made (dense mobility or friction; turning a constant one is not making it), products with M, for getStepStatistics(). */
    long long numMatrices = 0, numProducts = 0, numSolverIterations = 0;

private:
    friend class MobilityProblem;
    Placement placementOf(const std::vector<Pose>& poses) const;
    /** The particles' mobility at poses a small displacement away, beside that at the poses set last. */
    MobilityAt& particlesNearby(const std::vector<Pose>& poses);
    Eigen::MatrixXd ownModelMobility(int element) const;
    void checkSites(int element);
    void checkPlaces();
    void computeFriction();
    void congruence(Eigen::MatrixXd& matrix, const std::vector<Eigen::MatrixXd>& factors_body, bool transposed) const;
    void multiplyByFactors(Eigen::MatrixXd& vectors, const std::vector<Eigen::MatrixXd>& factors_body,
                           bool transposed) const;

    const RigidMotion motion;
    NullTwists nullTwists;
    bool constant = false, hasOwnTensors = false, aloneInUniformFluid = false;
    std::vector<Eigen::MatrixXd> B_body, inverseB_body;  // of elements with own tensors
    std::unique_ptr<const MobilityModel> model;          // of all particles; none: no particles
    std::unique_ptr<MultiblobSolver> multiblobSolver;    // made when first needed

    std::vector<Pose> poses;
    std::vector<Eigen::Matrix3d> turns, turnsNearby;  // their rotations, and those of particlesNearby()
    BoxVectors box = {};
    Placement placement;
    std::unique_ptr<MobilityAt> here, elsewhere;  // the particles' mobility; made when first needed
    std::vector<OpenMM::Vec3> placesInFormulas;
    CoincidenceCheck coincidence;
    CholeskyFactor factor;
    Eigen::MatrixXd K, M, N, xi, constantMobility, constantFriction, scratch;
    bool mobilityIsKnown = false, frictionIsKnown = false;
};

}  // namespace RigidHIPlugin

#endif

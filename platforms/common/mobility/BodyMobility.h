#ifndef RIGIDHI_BODY_MOBILITY_H_
#define RIGIDHI_BODY_MOBILITY_H_

#include <Eigen/Core>
#include <functional>
#include <memory>
#include <vector>

#include "mobility/CholeskyFactor.h"
#include "mobility/CoincidenceCheck.h"
#include "mobility/MobilityModel.h"
#include "mobility/MultiblobSolver.h"

namespace RigidHIPlugin {

/** What the fluid sees of a body, or of a free particle. */
struct FluidElement {
    int body = -1;                       // index of the body, -1: a free particle
    std::vector<int> particles;          // hydrodynamic particles, indices in the System
    std::vector<Eigen::Vector3d> sites;  // their places in the body frame, nm from the body's origin
    std::vector<double> radii;           // nm
    Eigen::MatrixXd ownMobility;         // 6 x 6, body frame, or empty: setBodyMobility()

    bool isFree() const { return body < 0; }
    /** One hydrodynamic particle takes force and torque; those of a multiblob take forces only. */
    bool isSphere() const { return !isFree() && particles.size() == 1; }
    int numRows() const { return isFree() ? 3 : 6; }
};

/** The hydrodynamic particles of elements, in their order. */
HydrodynamicParticles particlesOf(const std::vector<FluidElement>& elements);

/** Where a body is. */
struct Pose {
    Eigen::Vector3d R = Eigen::Vector3d::Zero();
    Eigen::Matrix3d A = Eigen::Matrix3d::Identity();  // body frame to lab frame
};

/**
 * The mobility of rigid bodies that feel each other, made from that of their particles: N = (K^T M^-1 K)^-1, where the rows
 * of K give the velocities of the particles from V and W of their body (Westwood 2022, eqs. 7 to 10).
 * A sphere carries force and torque, the blobs of a multiblob forces only.
 *
 * Rows: six a body (V, W about its origin; lab frame), then three a free particle, in the order of the elements.
 * Where all blobs of a body are on a line, its friction has a null vector n, rotation about the line, and its mobility is the symmetric
 * generalised inverse (xi N xi = xi, N xi N = N) whose twists do not turn the body about the line, W.line = 0. For an origin on the
 * line that is the pseudo-inverse; elsewhere the latter would depend on the origin and on units, and this does not.
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

    const std::vector<FluidElement>& getElements() const { return elements; }
    int getNumRows() const { return numRows; }
    int getNumParticleRows() const { return particles.numRows; }
    int firstRow(int element) const { return rows[element]; }
    /** Whether the tensor is that of one body in a homogeneous fluid, known once for all in its own frame. */
    bool isConstantInBodyFrame() const { return constant; }
    /** Whether friction() is the matrix that costs less. */
    bool prefersFriction() const;
    /** The null vector of element's friction in its frame (unit length), if its blobs are on a line. */
    bool hasNullVector(int element) const { return nullVectors[element].size() > 0; }
    const Eigen::VectorXd& getNullVector_body(int element) const { return nullVectors[element]; }

    /**
     * One pose an element; a free particle's A is not used. @throws what the model's at() throws, and for two particles of one radius at
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
    bool multipliesWithoutIterations() const { return identityK && canApplyMatrixFree(); }
    /** Whether mobilityByIterations() takes less time than mobility(). By numbers of rows only, so that it is so on any machine. */
    bool isWorthIterations() const {
        return canApplyMatrixFree() && !identityK && getNumParticleRows() > model->rowsWorthIterations() * numRows;
    }
    /** N by applyMatrixFree() to its columns, to a relative tolerance, and symmetric. */
    Eigen::MatrixXd mobilityByIterations(double tolerance);

    /** Whether there is one element only in a fluid that is the same everywhere. */
    bool isAloneInUniformFluid() const { return aloneInUniformFluid; }
    /**
     * Whether div N = 0 at all poses: spheres about their centres do not feel how they are turned, so the divergence is that of the
     * particles' mobility.
     */
    bool isDivergenceFree() const { return identityK && !hasOwnTensors && model && model->isDivergenceFree(); }
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
    void fillK(const std::vector<Pose>& poses, Eigen::MatrixXd& K) const;
    void placeParticles(const std::vector<Pose>& poses, Placement& placement) const;
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

    std::vector<FluidElement> elements;
    std::vector<int> rows;
    int numRows = 0;
    bool constant = false, identityK = true, hasOwnTensors = false, aloneInUniformFluid = false;
    std::vector<Eigen::VectorXd> nullVectors;            // of elements, in the body frame; mostly empty
    std::vector<Eigen::MatrixXd> B_body, inverseB_body;  // of elements with own tensors
    std::unique_ptr<const MobilityModel> model;          // of all particles; none: no particles
    std::unique_ptr<MultiblobSolver> multiblobSolver;    // made when first needed
    HydrodynamicParticles particles;
    std::vector<int> firstParticle;  // of each element

    std::vector<Pose> poses;
    BoxVectors box = {};
    Placement placement;
    std::unique_ptr<MobilityAt> here, elsewhere;  // the particles' mobility; made when first needed
    std::vector<OpenMM::Vec3> placesInFormulas;
    CoincidenceCheck coincidence;
    CholeskyFactor factor;
    Eigen::MatrixXd K, M, N, xi, constantMobility, constantFriction, scratch;
    bool mobilityIsKnown = false, frictionIsKnown = false;
};

/** K of one element: velocities of its hydrodynamic particles (and angular velocity of a sphere) from V and W. */
Eigen::MatrixXd rigidMotion(const FluidElement& element, const Eigen::Matrix3d& A);
/**
 * The inverse of a body's friction matrix, 6 x 6, with at most one null vector (of unit length; or empty): then the generalised
 * inverse that BodyMobility describes.
 */
Eigen::MatrixXd generalisedInverse(const Eigen::MatrixXd& friction, const Eigen::VectorXd& nullVector);
/**
 * Q twists, in place: the multiple of the null twist n = (V, line) subtracted that makes them not turn about the line; and Q^T wrenches: the
 * torque about the line subtracted that makes them do no work on n. Columns are cases of their own.
 */
void removeTurnAboutLine(const Eigen::Matrix<double, 6, 1>& nullVector, Eigen::Ref<Eigen::MatrixXd> twists);
void removeTorqueAboutLine(const Eigen::Matrix<double, 6, 1>& nullVector, Eigen::Ref<Eigen::MatrixXd> wrenches);
/** The 6 x 6 matrix diag(A, A) of a rotation. */
Eigen::Matrix<double, 6, 6> twoRotations(const Eigen::Matrix3d& A);

}  // namespace RigidHIPlugin

#endif

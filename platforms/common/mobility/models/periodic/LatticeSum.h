#ifndef RIGIDHI_LATTICE_SUM_H_
#define RIGIDHI_LATTICE_SUM_H_

#include <Eigen/Core>
#include <complex>
#include <vector>

#include "mobility/MobilityModel.h"
#include "mobility/models/periodic/Lattice.h"
#include "mobility/models/periodic/PairFunctions.h"

namespace RigidHIPlugin {

/**
 * How a model spreads the force and the torque of a particle over the fluid. A Spreading gives s(k)
 * and t(k) of the equation of LatticeSum, which depend on the radius alone, and the pair functions
 * of two such particles in unbounded fluid.
 */
class Spreading {
public:
    virtual ~Spreading() {}
    /** s(k) and t(k) of a particle of radius a; both are 1 at k = 0. */
    virtual double ofForce(double a, double k) const = 0;
    virtual double ofTorque(double a, double k) const = 0;
    /** -s''/2 at k = 0: the average of a quadratic polynomial v is v + laplacian(a) nabla^2 v. */
    virtual double laplacian(double a) const = 0;
    /** All three. */
    WaveFactors waveFactors(double a, double k) const {
        return {ofForce(a, k), ofTorque(a, k), laplacian(a)};
    }
    /**
     * The functions of two particles in unbounded fluid, at any distance. a_i = 0 is a point of the
     * fluid, outside or inside particle j.
     *
     * @param torques, stresslets  whether to compute their functions, too
     */
    virtual PairFunctions free(double a_i, double a_j, double distance, bool torques,
                               bool stresslets) const = 0;
    /**
     * The cut-offs of sums of depth q, which neglect terms below exp(-q^2). With a splitting of
     * width 1/xi, functions of the distance are negligible beyond reach() for particles up to the
     * radius `largest`. Waves are negligible beyond the wave number largestWave() for radii from
     * `smallest` on.
     *
     * @param inverseSplitting  1/xi, nm; 0 for no splitting, with waves alone
     */
    virtual double reach(double q, double inverseSplitting, double largest) const = 0;
    virtual double largestWave(double q, double inverseSplitting, double smallest,
                               bool hasTorque) const = 0;
    /** Whether waves alone converge, so that inverseSplitting may be 0. */
    virtual bool convergesByWaves() const = 0;
};

/**
 * The mobility of particles and all their images in a periodic box. The mean velocity of the fluid
 * (and bodies) is zero.
 *
 * Equation:  With D(F) = s(k) F, D(T) = i/2 t(k) k x T and D(S) = -i t(k) S.k,
 *                M_ij = 1/(eta V) sum over k != 0 of D_i^T (1 - kk) k^-2 D_j exp(i k.r_ij).
 * Method:    Ewald's splitting by Hasimoto's H(k) = (1 + k^2/4 xi^2) exp(-k^2/4 xi^2). The part
 *            with H is a sum over waves, B B^T of real columns, which is one symmetric product of
 *            matrices. The part without H is a sum over pairs and images: the closed form in
 *            unbounded fluid, minus the integral over k with H. The integrand is even, analytic and
 *            cut off by a Gaussian, so the trapezoidal rule converges faster than any power. It
 *            takes some 25 nodes, and no radii or distances cause cancellation.
 * Accuracy:  1e-13 of own mobilities. The box, the radii and this accuracy determine xi and the
 *            cut-offs. xi is chosen for the least cost of both parts together.
 * Cost:      10 us for each pair of spheres with torque, 4 us without, 21 us with stresslets (one
 *            thread of a machine of 2023), in any box.
 * Reference: Hasimoto, J. Fluid Mech. 5:317 (1959); Beenakker, J. Chem. Phys. 85:1581 (1986);
 *            docs/theory/periodic_fluid.md.
 */
class LatticeSum {
public:
    /**
     * @param stresslets  whether each particle has 5 more rows, after all others: stresslets and
     *     strain rates
     * @param forPoints  whether the sum serves addFlowAt() (the flow at points of the fluid)
     *     instead of compute()
     */
    LatticeSum(const HydrodynamicParticles& particles, const Spreading& spreading, bool stresslets,
               bool forPoints = false);

    /** Use this box from now on. */
    void setBox(const BoxVectors& box);
    const Lattice& getLattice() const { return lattice; }
    int getNumRows() const { return particles.numRows + (stresslets ? 5 * particles.size() : 0); }
    /**
     * The matrix, in units of 1/(8 pi eta). It is symmetric to the last bit.
     *
     * @param contact  whether overlapping pairs have the functions of contact in unbounded fluid
     */
    void compute(const std::vector<OpenMM::Vec3>& positions, bool contact, Eigen::MatrixXd& matrix);

    /**
     * Add to the velocities `factor` times the flow of sources at points, in units of 1/(8 pi eta).
     * Cost: 10 us for each particle and point.
     */
    void addFlowAt(const std::vector<OpenMM::Vec3>& positions, const FlowSources& sources,
                   const std::vector<OpenMM::Vec3>& points, double factor, Velocities& velocities);

    /** For tests: split at this xi (1/nm); 0 for the cheapest xi. Call this before setBox(). */
    void setSplitting(double xi) { wantedSplitting = xi; }
    double getSplitting() const { return inverseSplitting > 0 ? 1 / inverseSplitting : 0; }

private:
    /** s and t at the wave numbers of a list, with a column for each of the distinct radii. */
    struct Factors {
        Eigen::ArrayXXd s, t;  // [wave number][kind]
    };
    /** Images of one pair, in lanes. */
    static constexpr int numLanes = 8;
    using Lanes = Eigen::Array<double, numLanes, 1>;

    double estimateCost(double inverseSplitting) const;
    void chooseSplitting();
    void fillFactors(const Eigen::ArrayXd& waveNumbers, Factors& factors) const;
    /** exp(-i n theta) of positions along each reciprocal vector, for the present waves. */
    struct Phases {
        Eigen::Vector3i count;
        std::vector<Eigen::MatrixXcd> along;  // [direction](n + count, place)
        std::complex<double> of(const Eigen::Vector3i& wave, int place) const {
            return along[0](count[0] + wave[0], place) * along[1](count[1] + wave[1], place) *
                   along[2](count[2] + wave[2], place);
        }
    };
    void fillPhases(const std::vector<OpenMM::Vec3>& places, Phases& phases) const;
    void fillColumns(int firstWave, int size);
    template <class Add>
    void forImages(const Eigen::Vector3d& difference, const Add& add);
    void addWaves(const std::vector<OpenMM::Vec3>& positions, Eigen::MatrixXd& matrix);
    void addPairs(const std::vector<OpenMM::Vec3>& positions, bool contact,
                  Eigen::MatrixXd& matrix);
    void setPairWeights(int kind_i, int kind_j, bool torques);
    void screenedNear(double distance, PairFunctions& f) const;
    void screenedFar(const Lanes& squares, PairFunctions (&f)[numLanes]) const;
    void place(const PairBlocks& pair, int i, int j, Eigen::MatrixXd& matrix) const;
    int firstStresslet(int i) const { return particles.numRows + 5 * i; }

    const HydrodynamicParticles particles;
    const Spreading& spreading;
    const bool stresslets;
    bool hasTorques = false;
    double smallest = 0, largest = 0;  // radii
    double wantedSplitting = 0;
    std::vector<int> kind;      // the index of each particle's radius among the distinct radii
    std::vector<double> kinds;  // distinct radii

    BoxVectors box = {};
    Lattice lattice;
    double inverseSplitting = 0, reach = 0;
    std::vector<Eigen::Vector3i> waves;
    Eigen::ArrayXd waveLengths, waveWeights;
    Factors ofWaves;
    std::vector<Eigen::Vector3d> images;
    double step = 0;  // of the trapezoidal rule
    Eigen::ArrayXd nodes, nodeWeights;
    Factors ofNodes;

    // weights of the present pair
    Eigen::ArrayXd ss, st, ts, tt;
    bool withTorques = false;
    // of the present waves
    Eigen::MatrixXd columns;
    Phases phases;
    std::vector<Eigen::Vector3d> found;
};

}  // namespace RigidHIPlugin

#endif

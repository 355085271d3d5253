#ifndef RIGIDHI_GRID_PLANES_H_
#define RIGIDHI_GRID_PLANES_H_

#include <complex>
#include <functional>
#include <mutex>
#include <vector>

#include "mobility/models/confined/PlaneConditions.h"
#include "mobility/models/forcecoupling/GridModes.h"

namespace RigidHIPlugin {

/**
 * PlaneConditions for the modes of a grid: the forces of planes turn the flow of a periodic grid
 * into that of a fluid between planes. S includes all modes, so walls are at their true positions,
 * to the error of the grid. Only the matrices of random fields also use S of the grid's own modes.
 *
 * A wave vector along the planes has 3p complex unknowns: number 3 j + c is component c of unknown
 * j of PlaneConditions. Unknowns are sums of modes u(kz) over kz with the factors of profiles. The
 * response to forces is u(kz) + (1 - k k/k^2) k^-2 f(kz)/P, where f(kz) is a sum over unknowns with
 * the conjugate factors, and forces are in units of the viscosity.
 *
 * An instance is immutable, except that it makes the matrices of random fields on first use.
 */
class GridPlanes {
public:
    /** @param shape  its edge along z is the period of the conditions */
    GridPlanes(const PlaneConditions& conditions, const GridShape& shape);
    const PlaneConditions& getConditions() const { return conditions; }
    int numUnknowns() const { return 3 * conditions.numPlanes(); }

    /**
     * The factors of the modes kz = 0, 1, ... in an unknown: real and even in kz, or imaginary and
     * odd.
     */
    struct Profile {
        int unknown;  // j
        bool isImaginary;
        std::vector<double> values;  // the factors, or their imaginary parts
    };
    const std::vector<Profile>& getProfiles() const { return profiles; }
    /** The nonzero profiles of a grid, and the profile of the flux, which is real. */
    static std::vector<Profile> profilesOf(const PlaneConditions& conditions,
                                           const GridShape& shape);
    static std::vector<double> profileOfFlux(const PlaneConditions& conditions,
                                             const GridShape& shape);
    /**
     * S of the grid's modes. Each mode counts with a part that depends on its wave number squared.
     */
    using PartOfMode = std::function<PlaneConditions::Real(PlaneConditions::Real)>;
    static PlaneConditions::Matrices truncated(const PlaneConditions& conditions,
                                               const std::vector<Profile>& profiles,
                                               const GridShape& shape, PlaneConditions::Real k,
                                               const PartOfMode& part);
    static PlaneConditions::Matrix truncatedMean(const PlaneConditions& conditions,
                                                 const std::vector<Profile>& profiles,
                                                 const std::vector<double>& fluxProfile,
                                                 const GridShape& shape, const PartOfMode& part);

    /**
     * The forces that give the velocities on planes their law, from the present velocities there.
     * The wave vector has the indices x and y along the axes, and must not be 0.
     */
    void respond(int x, int y, const std::complex<double>* velocities,
                 std::complex<double>* forces) const {
        multiply(x, y, responses, velocities, forces);
    }
    /**
     * The matrices of the wave vectors with the index y for x = 0 ... size/2: element i of one, in
     * the order of columns, of t before lz (PlaneConditions), is at i * numOfRow() + x. They are 0
     * for wave vectors without forces. Forces are minus these matrices times velocities, along l, t
     * and z. The matrices of random fields are available after prepareFields().
     */
    const double* responsesOfRow(int y) const { return &responses[placeOfRow(y)]; }
    const double* inversesOfRow(int y) const { return &inverses[placeOfRow(y)]; }
    const double* rootsOfRow(int y) const { return &roots[placeOfRow(y)]; }
    int numOfRow() const { return numX; }
    /**
     * Likewise for the velocities of a random field.
     *
     * @param numbers  random numbers of the unknowns
     * @param scale    of the numbers
     */
    void respondRandomly(int x, int y, const std::complex<double>* velocities,
                         const std::complex<double>* numbers, double scale,
                         std::complex<double>* forces) const;
    /**
     * Add the flow of the forces of planes at a height z of the grid, for the wave vector of x and
     * y. It has all modes kz, also those that the grid excludes. So the flow at points is at rest
     * on walls.
     */
    void addFlow(int x, int y, double z, const std::complex<double>* forces,
                 std::complex<double>* velocities) const;
    /** Likewise for the forces of a mean flow along x or y, from meanForces(). */
    double meanFlow(double z, const Eigen::VectorXd& forces) const;
    /** The forces of the planes in respondToMean(), and the uniform velocity. */
    Eigen::VectorXd meanForces(const std::complex<double>* modes, double netForce) const;
    /**
     * Let the planes respond to a mean flow along x or y.
     *
     * @param modes     modes kz = 0, 1, ... of the flow; the response is added to them
     * @param netForce  along the axis: mode 0 of the forces over the viscosity, in the units of the
     *     flow's modes
     */
    void respondToMean(std::complex<double>* modes, double netForce) const;
    /** Likewise for a random field, with conditions.numOfMean() real numbers. */
    void respondToMeanRandomly(std::complex<double>* modes, const double* numbers,
                               double scale) const;
    /** The scale of random numbers for fields in a fluid of this viscosity. */
    double scaleOfNumbers(double viscosity) const {
        return std::sqrt(shape.edge[2] / (viscosity * shape.numNodes()));
    }
    /** The random numbers of the mean flow along x and y. */
    class MeanNumbers {
    public:
        MeanNumbers(const GridPlanes& planes, const ModeNoise& noise);
        const double* along(int axis) const { return numbers[axis]; }

    private:
        double numbers[2][4];
    };
    /** Make the matrices of random fields, unless they already exist. */
    void prepareFields() const;
    /** Bytes of the matrices for so many planes, with those of random fields. */
    static double memory(int numPlanes, const GridShape& shape) {
        return 8.0 * 3 * numbersOf(numPlanes) * (shape.size[0] / 2 + 1) * (shape.size[1] / 2 + 1);
    }

private:
    using Matrices = PlaneConditions::Matrices;
    using Matrix = PlaneConditions::Matrix;
    /** The numbers of both matrices of a wave vector, for velocities along t, and along l and z. */
    static size_t numbersOf(int numPlanes) { return 5 * numPlanes * numPlanes; }
    void makeFields() const;
    double waveNumber(int x, int y) const;
    size_t placeOfRow(int y) const { return numbers * numX * std::min(y, shape.size[1] - y); }
    void store(const Matrices& from, int x, int y, std::vector<double>& to) const;
    void multiply(int x, int y, const std::vector<double>& matrices,
                  const std::complex<double>* from, std::complex<double>* to) const;
    /** Sums over the modes of a mean flow, and the transpose. */
    Eigen::VectorXd meanOf(const std::complex<double>* modes) const;
    void addMean(const Eigen::VectorXd& forces, std::complex<double>* modes) const;

    const PlaneConditions conditions;
    GridShape shape;
    int numModes, numX;
    size_t numbers;
    std::vector<Profile> profiles;
    std::vector<double> fluxProfile;  // for a channel with zero flux
    std::vector<double> responses;
    Eigen::MatrixXd meanResponse;
    mutable std::once_flag fieldsAreMade;
    mutable std::vector<double> inverses, roots;
    mutable Eigen::MatrixXd meanInverse, meanRoot;
};

}  // namespace RigidHIPlugin

#endif

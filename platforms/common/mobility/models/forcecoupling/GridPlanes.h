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
 * PlaneConditions for the modes of a grid: what turns the flow of a periodic grid into that of a
 * fluid between planes. Only the matrices of forces are made from the grid's own modes. S is that
 * of all modes, so walls are where they should be, to the error of the grid.
 *
 * A wave vector along the planes has 3p complex unknowns: number 3 j + c is component c of unknown
 * j of PlaneConditions. Unknowns are sums of modes u(kz) over kz with the factors of profiles.
 * Response to forces: u(kz) + (1 - k k/k^2) k^-2 f(kz)/P, where f(kz) is a sum over unknowns with
 * the conjugate factors, and forces are in units of the viscosity.
 *
 * An instance does not change once it is made, except that the matrices of random fields are made
 * when they are first needed.
 */
class GridPlanes {
public:
    /** @param shape  its edge along z is the period of the conditions */
    GridPlanes(const PlaneConditions& conditions, const GridShape& shape);
    const PlaneConditions& getConditions() const { return conditions; }
    int numUnknowns() const { return 3 * conditions.numPlanes(); }

    /** A factor of modes kz = 0, 1, ... in an unknown: real and even in kz, or imaginary and odd.
     */
    struct Profile {
        int unknown;  // j
        bool isImaginary;
        std::vector<double> values;  // the factor, or its imaginary part
    };
    const std::vector<Profile>& getProfiles() const { return profiles; }
    /** The profiles of a grid that are not 0, and that of the flux, which is real. */
    static std::vector<Profile> profilesOf(const PlaneConditions& conditions,
                                           const GridShape& shape);
    static std::vector<double> profileOfFlux(const PlaneConditions& conditions,
                                             const GridShape& shape);
    /** S of the grid's modes, of which each has a part that depends on its wave number squared. */
    using PartOfMode = std::function<PlaneConditions::Real(PlaneConditions::Real)>;
    static PlaneConditions::Matrices truncated(const PlaneConditions& conditions,
                                               const std::vector<Profile>& profiles,
                                               const GridShape& shape, PlaneConditions::Real k,
                                               const PartOfMode& part);
    static PlaneConditions::Matrix truncatedMean(const PlaneConditions& conditions,
                                                 const std::vector<Profile>& profiles,
                                                 const std::vector<double>& fluxProfile,
                                                 const GridShape& shape, const PartOfMode& part);

    /** The forces that give the planes' velocities their law, from the velocities that they have.
     * The wave vector has the indices x and y along the axes, and is not 0. */
    void respond(int x, int y, const std::complex<double>* velocities,
                 std::complex<double>* forces) const {
        multiply(x, y, responses, velocities, forces);
    }
    /**
     * The matrices of the wave vectors with the index y for x = 0 ... size/2: element i of one, in
     * the order of columns, of t before lz (PlaneConditions), is at i * numOfRow() + x. They are 0
     * where there are no forces. Forces are minus these matrices times velocities, along l, t and
     * z. Those of random fields are there after prepareFields().
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
     * y. It has all modes kz, also those that the grid leaves out. So the flow at points is at rest
     * on walls.
     */
    void addFlow(int x, int y, double z, const std::complex<double>* forces,
                 std::complex<double>* velocities) const;
    /** Likewise of the forces of a mean flow along x or y, from meanForces(). */
    double meanFlow(double z, const Eigen::VectorXd& forces) const;
    /** The forces of the planes that respondToMean() finds, and the uniform velocity. */
    Eigen::VectorXd meanForces(const std::complex<double>* modes, double netForce) const;
    /**
     * Let the planes respond to a mean flow along x or y.
     *
     * @param modes     kz = 0, 1, ... of the flow, to which the response is added
     * @param netForce  along the axis: the mode 0 of the forces, in units of the flow's modes: over
     * the viscosity
     */
    void respondToMean(std::complex<double>* modes, double netForce) const;
    /** Likewise for a random field. The numbers, of conditions.numOfMean(), are real. */
    void respondToMeanRandomly(std::complex<double>* modes, const double* numbers,
                               double scale) const;
    /** The scale of random numbers for fields in a fluid of this viscosity. */
    double scaleOfNumbers(double viscosity) const {
        return std::sqrt(shape.edge[2] / (viscosity * shape.numNodes()));
    }
    /** Random numbers of the mean flow, along x and y. */
    class MeanNumbers {
    public:
        MeanNumbers(const GridPlanes& planes, const ModeNoise& noise);
        const double* along(int axis) const { return numbers[axis]; }

    private:
        double numbers[2][4];
    };
    /** Make the matrices of random fields, unless they are there. */
    void prepareFields() const;
    /** Bytes of the matrices. */
    double memory() const { return 8.0 * (responses.size() + inverses.size() + roots.size()); }

private:
    using Matrices = PlaneConditions::Matrices;
    using Matrix = PlaneConditions::Matrix;
    void makeFields() const;
    double waveNumber(int x, int y) const;
    size_t placeOfRow(int y) const { return numbers * numX * std::min(y, shape.size[1] - y); }
    void store(const Matrices& from, int x, int y, std::vector<double>& to) const;
    void multiply(int x, int y, const std::vector<double>& matrices,
                  const std::complex<double>* from, std::complex<double>* to) const;
    /** Sums over modes of a mean flow, and the other way round. */
    Eigen::VectorXd meanOf(const std::complex<double>* modes) const;
    void addMean(const Eigen::VectorXd& forces, std::complex<double>* modes) const;

    const PlaneConditions conditions;
    GridShape shape;
    int numModes, numX;
    size_t numbers;
    std::vector<Profile> profiles;
    std::vector<double> fluxProfile;  // for a channel without flux
    std::vector<double> responses;
    Eigen::MatrixXd meanResponse;
    mutable std::once_flag fieldsAreMade;
    mutable std::vector<double> inverses, roots;
    mutable Eigen::MatrixXd meanInverse, meanRoot;
};

}  // namespace RigidHIPlugin

#endif

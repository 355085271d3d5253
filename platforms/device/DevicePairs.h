#ifndef RIGIDHI_DEVICE_PAIRS_H_
#define RIGIDHI_DEVICE_PAIRS_H_

#include <openmm/common/ComputeArray.h>

#include <Eigen/Core>
#include <memory>
#include <mutex>
#include <set>
#include <string>
#include <vector>

#include "Device.h"
#include "ProductChoice.h"
#include "text/PairText.h"

namespace RigidHIPlugin {

/**
 * Sums over all pairs of particles with the Rotne-Prager-Yamakawa mobility on a device
 * (kernels/pairs.cc), for all models of a Context. Pairs are computed in floats, except overlapping
 * ones, and sums over more than 64 particles in double precision, so the error of a product is
 * below 1e-6 of its norm.
 *
 * The sums of a product do not depend on the device's order of work: the same positions and forces
 * give the same bits.
 *
 * If the device fails, for lack of double precision or memory, the host makes all products from
 * then on.
 */
class DevicePairs {
public:
    DevicePairs(std::unique_ptr<const Device> device, const std::string& platform,
                ProductWish wish);
    ~DevicePairs();

    /**
     * Whether the device makes products with this error for this number of particles.
     *
     * @param hasMultipoles  whether the host could use multipoles for these products
     */
    bool serves(int numParticles, bool hasWall, bool hasMultipoles, double error) const;
    /** Why the device makes no products; empty if it makes some. */
    std::string reasonForHost() const;
    /** Whether the device makes products, and which, for describeEffects(). */
    bool isOn() const;
    std::string describe() const;

    /** Spheres at a place, in the memory of the device. Lengths are in any unit near the radii. */
    class PlacedSpheres {
    public:
        PlacedSpheres(const std::vector<double>& radii, PairKind kind) : radii(radii), kind(kind) {}
        /** @param positions  x, y, z of each particle; with a wall, z is the height above it */
        void moveTo(const std::vector<double>& positions);

    private:
        friend class DevicePairs;
        const std::vector<double> radii;
        const PairKind kind;
        std::vector<OpenMM::mm_float4> places, remainders;  // until they are on the device
        struct There {
            OpenMM::ComputeArray places, remainders;
        };
        std::unique_ptr<There> there;
        bool isOnDevice = false;  // `there` has the present places
    };
    /**
     * Velocities, times 8 pi eta, caused by forces on other particles and by all images in a wall.
     *
     * @param loads  six rows for each particle, or three without torques; numbers near 1
     * @param sums   likewise
     * @return whether the device succeeded. If not, it makes no more products.
     */
    bool multiply(PlacedSpheres& place, const Eigen::MatrixXd& loads, Eigen::MatrixXd& sums);

    /** Records, while it lives, that a model of this many particles is alive. */
    class Note {
    public:
        Note(DevicePairs& pairs, int numParticles);
        ~Note();

    private:
        DevicePairs& pairs;
        const int numParticles;
    };

private:
    struct Kernels;
    Kernels& kernelsFor(PairKind kind);
    void sum(PlacedSpheres& place, const Eigen::MatrixXd& loads, int column, int columns,
             Eigen::MatrixXd& sums);
    const std::unique_ptr<const Device> device;
    OpenMM::ComputeContext& cc;
    const std::string platform;
    const ProductWish wish;
    mutable std::mutex mutex;  // several threads may step groups of bodies
    std::string broken;        // why the device makes no products any more
    std::multiset<int> sizes;  // of models that are alive
    std::unique_ptr<Kernels> kernels[2][2];
    struct Buffers {
        OpenMM::ComputeArray forces, torques, partialSums, sums;
    };
    std::unique_ptr<Buffers> buffers;
    std::vector<OpenMM::mm_float4> forceValues, torqueValues;  // in transfer to the device
    std::vector<double> sumValues;
};

}  // namespace RigidHIPlugin

#endif

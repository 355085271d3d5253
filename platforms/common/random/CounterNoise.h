#ifndef RIGIDHI_COUNTER_NOISE_H_
#define RIGIDHI_COUNTER_NOISE_H_

#include <Random123/philox.h>

#include <cmath>
#include <cstdint>
#include <cstring>

namespace RigidHIPlugin {

/**
 * Random numbers without state: a function of (seed, step, attempt, purpose, index, block) through
 * Random123's Philox4x32-10 (Salmon et al., SC'11). A run therefore does not depend on the number
 * of threads or the order of bodies. A resumed run continues the interrupted one, and a redone step
 * (another attempt) gets new numbers.
 */
struct NoiseStream {
    enum Law { Gaussian = 0, ThreePoint = 1, TwoPoint = 2 };
    /** The purpose of a number. Schemes with two draws in a step use both Draw purposes. */
    enum Purpose {
        FirstDraw = 0,
        SecondDraw = 1,
        FreeFirstDraw = 2,
        FreeSecondDraw = 3,
        Velocities = 4,
        FiniteDifference = 5,
        FreeFiniteDifference = 6,
        ParticleFirstDraw = 7,
        ParticleSecondDraw = 8,
        RandomField = 9
    };

    uint32_t seed = 1;
    int64_t step = 0;
    /** Below 2^16, as CustomRigidHIIntegrator::setMaximumRejections() guarantees. */
    uint32_t attempt = 0;
    Law law = Gaussian;
    /**
     * The index of a random field, if a Context has several: each field has its own numbers for the
     * same modes. 0 for all other purposes.
     */
    uint32_t field = 0;

    /** The counter of one block of two numbers. */
    r123::Philox4x32::ctr_type counter(uint32_t purpose, uint32_t index, uint32_t block) const {
        const uint64_t s = static_cast<uint64_t>(step);
        return {{static_cast<uint32_t>(s), static_cast<uint32_t>(s >> 32), index,
                 lastWord(purpose, block)}};
    }
    uint32_t lastWord(uint32_t purpose, uint32_t block) const {
        return purpose << 24 | (attempt & 0xffffu) << 8 | block;
    }
    /**
     * The second word of the Philox key. It separates this plugin's numbers from those of other
     * programs with the same seed.
     */
    static const uint32_t keyWord = 0x52484931u;

    /** Two independent numbers of mean 0 and variance 1. */
    void pair(uint32_t purpose, uint32_t index, uint32_t block, double& a, double& b) const {
        const auto bits =
            r123::Philox4x32()(counter(purpose, index, block), {{seed, keyWord + field}});
        const double u = uniform(bits[0], bits[1]), v = uniform(bits[2], bits[3]);
        if (law == Gaussian) {  // Box and Muller; 1 - u is in (0, 1]
            const double radius = std::sqrt(-2.0 * std::log(1.0 - u));
            const double angle = 2.0 * M_PI * v;
            a = radius * std::cos(angle);
            b = radius * std::sin(angle);
        } else {
            a = discrete(u);
            b = discrete(v);
        }
    }
    // The index of a mode of a random field on a grid, with the integer wave numbers |nx|, |ny| <
    // 4096, 0 <= nz < 4096. It is an argument of pair().
    static uint32_t indexOfMode(int nx, int ny, int nz) {
        return static_cast<uint32_t>(nx + 4096) << 19 | static_cast<uint32_t>(ny + 4096) << 6 |
               static_cast<uint32_t>(nz) >> 6;
    }
    static uint32_t blockOfMode(int nz, int component) {
        return (static_cast<uint32_t>(nz) & 63u) << 2 | static_cast<uint32_t>(component);
    }
    /** Uniform in [0, 1), 52 bits. */
    static double uniform(uint32_t low, uint32_t high) {
        const uint64_t bits = (static_cast<uint64_t>(high) << 32 | low) >> 12 | 0x3ff0000000000000u;
        double x;
        std::memcpy(&x, &bits, sizeof x);
        return x - 1.0;
    }

private:
    double discrete(double u) const {
        if (law == TwoPoint) return u < 0.5 ? -1.0 : 1.0;
        return u < 1.0 / 6.0 ? -std::sqrt(3.0) : u < 5.0 / 6.0 ? 0.0 : std::sqrt(3.0);
    }
};

}  // namespace RigidHIPlugin

#endif

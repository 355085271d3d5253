#ifndef RIGIDHI_GRID_NUMBERS_H_
#define RIGIDHI_GRID_NUMBERS_H_

#include <algorithm>
#include <memory>
#include <set>
#include <vector>

#include "UnitNoise.h"
#include "mobility/models/forcecoupling/GridFluid.h"

namespace RigidHITest {

/**
 * A fluid on a grid whose random fields have one random number, which a test sets. All others are
 * 0. The fluid lists the numbers that a field asks for.
 */
class TestedGridFluid : public RigidHIPlugin::PlainGridFluid {
public:
    /** Forget all numbers. Fields drawn before endList() add theirs. */
    static void startList() {
        numbers.clear();
        known.clear();
        only = -1;
        isListing = true;
    }
    static void endList() { isListing = false; }
    static int numNumbers() { return numbers.size(); }
    /** The number that is not 0, or -1 for none, and its value. The numbers have the variance 1. */
    static void set(int number, double value) {
        only = number;
        valueOfOnly = value;
    }

protected:
    std::unique_ptr<RigidHIPlugin::ModeNoise> modeNoise(const RigidHIPlugin::NoiseStream&,
                                                        uint32_t) const override {
        if (isListing) return std::make_unique<List>();
        if (only < 0) return std::make_unique<UnitNoise>(std::array<int, 3>{0, 0, 0}, 0, 0.0);
        const Number& number = numbers[only];
        const std::complex<double> value = valueOfOnly * number.value;
        return std::make_unique<UnitNoise>(
            number.plane < 0 ? UnitNoise(number.mode, number.component, value)
                             : UnitNoise::ofPlane(number.mode[0], number.mode[1], number.plane,
                                                  number.component, value));
    }

private:
    struct Number {
        std::array<int, 3> mode;
        int plane, component;  // plane -1: none
        std::complex<double> value;
    };
    /** Adds the numbers that are asked for: one of n and -n, which is its conjugate. */
    class List : public RigidHIPlugin::ModeNoise {
    public:
        void fill(const int* nx, int count, int ny, int nz,
                  std::complex<double>* values) const override {
            std::fill_n(values, 3 * count, 0.0);
            for (int i = 0; i < count; i++) add({nx[i], ny, nz}, -1);
        }
        void fillPlane(const int* nx, int count, int ny, int j,
                       std::complex<double>* values) const override {
            std::fill_n(values, 3 * count, 0.0);
            for (int i = 0; i < count; i++) add({nx[i], ny, 0}, j);
        }

    private:
        void add(const std::array<int, 3>& n, int plane) const {
            if (!known.insert({n[0], n[1], n[2], plane}).second ||
                ((n[0] != 0 || n[1] != 0 || n[2] != 0) &&
                 known.count({-n[0], -n[1], -n[2], plane}) > 0))
                return;
            const double root = std::sqrt(0.5);
            for (int c = 0; c < 3; c++) {
                numbers.push_back({n, plane, c, {root, 0}});
                numbers.push_back({n, plane, c, {0, root}});
            }
        }
    };
    static inline std::vector<Number> numbers;
    static inline std::set<std::array<int, 4>> known;  // modes and planes of the numbers
    static inline bool isListing = false;
    static inline int only = -1;
    static inline double valueOfOnly = 0;
};

}  // namespace RigidHITest

#endif

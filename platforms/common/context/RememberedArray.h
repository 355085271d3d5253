#ifndef RIGIDHI_REMEMBERED_ARRAY_H_
#define RIGIDHI_REMEMBERED_ARRAY_H_

#include <openmm/Vec3.h>

#include <algorithm>
#include <cstring>
#include <vector>

namespace RigidHIPlugin {

/**
 * The entries that an array had last, as far as they are known. Which entries are known is kept
 * apart from their values, because users may write any value, NaN too.
 */
class RememberedArray {
public:
    /** At first nothing is known. */
    explicit RememberedArray(int size) : values(size), known(size, false) {}
    void forgetAll() { std::fill(known.begin(), known.end(), allAreKnown = false); }
    void forget(int i) { known[i] = allAreKnown = false; }
    void remember(const std::vector<OpenMM::Vec3>& array) {
        values = array;
        allWereWritten();
    }
    void remember(int i, const OpenMM::Vec3& value) {
        values[i] = value;
        known[i] = true;
    }
    /** Whether entry i is known and has these bits. */
    bool is(int i, const OpenMM::Vec3& value) const {
        return known[i] && std::memcmp(&values[i], &value, sizeof value) == 0;
    }
    /** Whether all entries are known and have these bits. */
    bool is(const std::vector<OpenMM::Vec3>& array) const {
        return allAreKnown && array.size() == values.size() &&
               std::memcmp(values.data(), array.data(), values.size() * sizeof values[0]) == 0;
    }
    /** For loops, which then say what they have written. */
    double* data() { return &values[0][0]; }
    void wereWritten(const std::vector<int>& entries) {
        for (int i : entries) known[i] = true;
    }
    void allWereWritten() { std::fill(known.begin(), known.end(), allAreKnown = true); }

private:
    std::vector<OpenMM::Vec3> values;
    std::vector<char> known;
    bool allAreKnown = false;
};

}  // namespace RigidHIPlugin

#endif

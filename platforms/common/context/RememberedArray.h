#ifndef RIGIDHI_REMEMBERED_ARRAY_H_
#define RIGIDHI_REMEMBERED_ARRAY_H_

#include <openmm/Vec3.h>

#include <algorithm>
#include <cstring>
#include <vector>

namespace RigidHIPlugin {

/**
 * The last known entries of an array. A separate flag says whether an entry is known, because users
 * may write any value, NaN too.
 */
class RememberedArray {
public:
    /** At first nothing is known. */
    explicit RememberedArray(int size) : values(size), known(size, false), numUnknown(size) {}
    void forgetAll() {
        std::fill(known.begin(), known.end(), false);
        numUnknown = known.size();
    }
    void forget(int i) {
        numUnknown += known[i];
        known[i] = false;
    }
    void remember(const std::vector<OpenMM::Vec3>& array) {
        values = array;
        allWereWritten();
    }
    void remember(int i, const OpenMM::Vec3& value) {
        values[i] = value;
        wasWritten(i);
    }
    /** Whether entry i is known and has these bits. */
    bool is(int i, const OpenMM::Vec3& value) const {
        return known[i] && std::memcmp(&values[i], &value, sizeof value) == 0;
    }
    /** Whether all entries are known and have these bits. */
    bool is(const std::vector<OpenMM::Vec3>& array) const {
        return numUnknown == 0 && array.size() == values.size() &&
               std::memcmp(values.data(), array.data(), values.size() * sizeof values[0]) == 0;
    }
    /** For loops, which then report what they wrote by wereWritten(). */
    double* data() { return &values[0][0]; }
    void wereWritten(const std::vector<int>& entries) {
        for (int i : entries) wasWritten(i);
    }
    void allWereWritten() {
        std::fill(known.begin(), known.end(), true);
        numUnknown = 0;
    }

private:
    void wasWritten(int i) {
        numUnknown -= !known[i];
        known[i] = true;
    }
    std::vector<OpenMM::Vec3> values;
    std::vector<char> known;
    int numUnknown;
};

}  // namespace RigidHIPlugin

#endif

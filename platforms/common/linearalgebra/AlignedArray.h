#ifndef RIGIDHI_ALIGNED_ARRAY_H_
#define RIGIDHI_ALIGNED_ARRAY_H_

#include <cstddef>
#include <memory>
#include <new>

namespace RigidHIPlugin {

/** Doubles that begin where a cache line does, as packs and transforms want them. Not initialised. */
class AlignedArray {
public:
    /** What was in it is lost if the size changes. */
    void resize(size_t newSize) {
        if (newSize == count) return;
        memory.reset();
        count = 0;
        memory.reset(static_cast<double*>(::operator new(newSize * sizeof(double), std::align_val_t(alignment))));
        count = newSize;
    }
    size_t size() const { return count; }
    double* data() { return memory.get(); }
    const double* data() const { return memory.get(); }
    double& operator[](size_t i) { return memory.get()[i]; }
    double operator[](size_t i) const { return memory.get()[i]; }

    static constexpr size_t alignment = 64;

private:
    struct Free {
        void operator()(double* p) const { ::operator delete(p, std::align_val_t(alignment)); }
    };
    std::unique_ptr<double, Free> memory;
    size_t count = 0;
};

}  // namespace RigidHIPlugin

#endif

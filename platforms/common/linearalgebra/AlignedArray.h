#ifndef RIGIDHI_ALIGNED_ARRAY_H_
#define RIGIDHI_ALIGNED_ARRAY_H_

#ifdef __linux__
#include <sys/mman.h>
#endif

#include <cstddef>
#include <memory>
#include <new>

namespace RigidHIPlugin {

/**
 * An array that begins at a cache line, for packs and transforms. Its elements are not initialised.
 * A large array asks for large pages.
 */
template <typename T>
class AlignedArrayOf {
public:
    /** A change of size discards the contents. */
    void resize(size_t newSize) {
        if (newSize == count) return;
        memory.reset();
        count = 0;
        const size_t bytes = newSize * sizeof(T);
        // With small pages, a strided pass through a grid spends as much time on looking up pages
        // as on reading.
        const bool large = bytes >= 2 * largePage;
        const auto alignment = static_cast<std::align_val_t>(large ? largePage : cacheLine);
        T* const made = static_cast<T*>(::operator new(bytes, alignment));
        memory = std::unique_ptr<T, Free>(made, Free{alignment});
#ifdef __linux__
        if (large) madvise(made, bytes / largePage * largePage, MADV_HUGEPAGE);  // a request only
#endif
        count = newSize;
    }
    size_t size() const { return count; }
    T* data() { return memory.get(); }
    const T* data() const { return memory.get(); }
    T& operator[](size_t i) { return memory.get()[i]; }
    T operator[](size_t i) const { return memory.get()[i]; }

private:
    static constexpr size_t cacheLine = 64, largePage = 2 << 20;
    struct Free {
        std::align_val_t alignment = static_cast<std::align_val_t>(cacheLine);
        void operator()(T* p) const { ::operator delete(p, alignment); }
    };
    std::unique_ptr<T, Free> memory;
    size_t count = 0;
};

using AlignedArray = AlignedArrayOf<double>;

}  // namespace RigidHIPlugin

#endif

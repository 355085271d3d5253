#ifndef RIGIDHI_COLUMN_TRANSFORM_H_
#define RIGIDHI_COLUMN_TRANSFORM_H_

#include <cstddef>
#include <vector>

namespace RigidHIPlugin {

/** Columns that are transformed at once, for all number types and instruction sets. */
const int columnsOfBlock = 8;

/** A block of columns of complex numbers: element i has its real parts at re + i stride, and its imaginary parts at im + i stride. */
template <typename T>
struct Columns {
    T *re, *im;
    size_t stride;
    /** One element after the other, real parts before imaginary ones. */
    static Columns packed(T* numbers) { return {numbers, numbers + columnsOfBlock, 2 * columnsOfBlock}; }
    /** For which a transform there is the one back. */
    Columns conjugate() const { return {im, re, stride}; }
};

/**
 * The discrete Fourier transform y_j = sum_k exp(-2 pi i j k/n) x_k of blocks of columns, for any n; fast if n has no prime factors above 7.
 *
 * Method:    Stockham's autosort in passes of small radices, all columns of a block by the same instructions. What is done depends on n only, so the same columns
 *            have the same transforms whoever does them, wherever they are.
 * Cost:      O(n sum of radices) a column. Measured against FFTW's: benchmarks/README.md.
 * Reference: Van Loan, Computational Frameworks for the Fast Fourier Transform (SIAM, 1992), section 1.7.
 */
template <typename T>
class ColumnTransform {
public:
    ColumnTransform() {}
    explicit ColumnTransform(int size);
    int getSize() const { return size; }
    /** Numbers that apply() works with. */
    size_t scratchNumbers() const { return 2 * 2 * columnsOfBlock * (size_t)size; }
    /** from -> to, which may be the same. @param scratch  apart from both, aligned as cache lines are */
    void apply(const Columns<T>& from, const Columns<T>& to, T* scratch) const;

    /** One pass: columns of `length` are made of `radix` times as many of length/radix. */
    struct Pass {
        int radix, length, stride;
        size_t twiddles;  // radix - 1 complex numbers for each of length/radix
        size_t roots;     // those of unity, of the odd prime factor
        int oddFactor;
    };
    const std::vector<Pass>& getPasses() const { return passes; }
    const T* numbersAt(size_t i) const { return numbers.data() + i; }

private:
    int size = 0;
    std::vector<Pass> passes;
    std::vector<T> numbers;
};

/** Radices whose product is n: as few as possible, and of these the smallest sum; primes above 7 for themselves. The largest is the last. */
std::vector<int> radicesOf(int n);

}  // namespace RigidHIPlugin

#endif

#ifndef RIGIDHI_KERNEL_TEXT_H_
#define RIGIDHI_KERNEL_TEXT_H_

#include <functional>
#include <map>
#include <string>

#include "text/Line.h"

namespace RigidHIPlugin {

/**
 * Run a formula over lines, and return what it did.
 *
 * @param greater  the answer to comparisons
 */
Program trace(const std::function<void()>& formula, bool greater = true);

/** The numbers that a block of kernel text computes with. */
struct NumberType {
    /** The type of all variables of the block. */
    std::string name = "number";
    /** Constants other than 0 are at least so large: formulas have some that floats cannot hold. */
    double least = 0;
    /** Whether inputs are of another type. */
    bool convertsInputs = false;
    /**
     * Whether each operation is rounded by itself, so that two kernels have the same result bit for
     * bit; otherwise compilers may fuse multiplications and additions.
     */
    bool exact = false;
};

/**
 * A program as the text of a kernel: one line a step, in a block of its own, with variables of the
 * given type. Inputs and outputs are variables that the kernel declares before. The text is valid
 * in OpenCL C, CUDA and HIP.
 */
std::string textOf(const Program& program, const NumberType& type = NumberType());

/** A text in which these words are replaced by others. */
std::string replaceWords(const std::string& text,
                         const std::map<std::string, std::string>& replacements);

/** The source of kernels, and definitions that come before it. */
struct KernelProgram {
    std::string source;
    std::map<std::string, std::string> defines;
    /** All in one, to be compared. */
    std::string whole() const;
};

/**
 * Run a program on the host, in double precision, one step after the other.
 *
 * @param values  those of the inputs; the outputs are added
 */
void runOnHost(const Program& program, std::map<std::string, double>& values);

}  // namespace RigidHIPlugin

#endif

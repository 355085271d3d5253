#ifndef RIGIDHI_KERNEL_TEXT_H_
#define RIGIDHI_KERNEL_TEXT_H_

#include <functional>
#include <map>
#include <string>

#include "text/Line.h"

namespace RigidHIPlugin {

/**
 * Run a formula over lines, and return its operations.
 *
 * @param greater  the answer to comparisons
 */
Program trace(const std::function<void()>& formula, bool greater = true);

/** The numbers that a block of kernel text computes with. */
struct NumberType {
    /** The type of all variables of the block. */
    std::string name = "number";
    /**
     * The least magnitude of constants other than 0; smaller ones are raised to it. Formulas
     * contain constants that floats cannot hold.
     */
    double least = 0;
    /** Whether inputs are of another type. */
    bool convertsInputs = false;
    /**
     * Whether each operation is rounded by itself, so that two kernels give the same result bit for
     * bit. If not, compilers may fuse multiplications and additions.
     */
    bool exact = false;
};

/**
 * A program as the text of a kernel: a line for each step, in a block of its own, with variables of
 * the given type. Inputs and outputs are variables that the kernel declares before. The text is
 * valid in OpenCL C, CUDA and HIP.
 */
std::string textOf(const Program& program, const NumberType& type = NumberType());

/** The text with these words replaced by others. */
std::string replaceWords(const std::string& text,
                         const std::map<std::string, std::string>& replacements);

/** The source of kernels, and definitions that come before it. */
struct KernelProgram {
    std::string source;
    std::map<std::string, std::string> defines;
    /** Source and definitions in one string, for comparisons. */
    std::string whole() const;
};

/**
 * Run a program on the host, in double precision, one step after the other.
 *
 * @param values  values of the inputs; receives those of the outputs
 */
void runOnHost(const Program& program, std::map<std::string, double>& values);

}  // namespace RigidHIPlugin

#endif

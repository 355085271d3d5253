// CUDA's compiler takes the kernels of bodies and of products, in each precision. It needs no GPU.
// Where NVRTC is not installed, the test is skipped.

#include <dlfcn.h>
#include <array>

#include "TestSupport.h"
#include "text/PairText.h"
#include "text/SchemeText.h"

using namespace RigidHIPlugin;
using namespace RigidHITest;
using namespace std;

namespace {

/** NVRTC's functions, found when the test runs. */
class Nvrtc {
public:
    Nvrtc() {
        for (const char* name : {"libnvrtc.so", "/usr/local/cuda/lib64/libnvrtc.so",
                                 "libnvrtc.so.13", "libnvrtc.so.12", "libnvrtc.so.11.2"})
            if (!library) library = dlopen(name, RTLD_NOW);
    }
    explicit operator bool() const { return library != nullptr; }
    /** @return errors; empty: it compiles */
    string compile(const string& source) const {
        void* program = nullptr;
        function<int(void**, const char*, const char*, int, const char* const*,
                     const char* const*)>(find<int(void**, const char*, const char*, int,
                                                   const char* const*, const char* const*)>(
            "nvrtcCreateProgram"))(&program, source.c_str(), nullptr, 0, nullptr, nullptr);
        const char* options[] = {"--use_fast_math", "--gpu-architecture=compute_80"};
        string log;
        if (find<int(void*, int, const char**)>("nvrtcCompileProgram")(program, 2, options) != 0) {
            size_t size = 0;
            find<int(void*, size_t*)>("nvrtcGetProgramLogSize")(program, &size);
            log.resize(size);
            find<int(void*, char*)>("nvrtcGetProgramLog")(program, &log[0]);
        }
        find<int(void**)>("nvrtcDestroyProgram")(&program);
        return log;
    }

private:
    template <class Function>
    Function* find(const char* name) const {
        return reinterpret_cast<Function*>(dlsym(library, name));
    }
    void* library = nullptr;
};

/** What OpenMM's CUDA platform puts before a program, as far as these kernels use it. */
string prelude(const string& precision) {
    const string real = precision == "double" ? "double" : "float",
                 mixed = precision == "single" ? "float" : "double";
    string text = precision == "mixed" ? "#define USE_MIXED_PRECISION 1\n" : "";
    for (const auto& type : {pair<string, string>("real", real), {"mixed", mixed}}) {
        text += "typedef " + type.second + " " + type.first + ";\n";
        text += "typedef " + type.second + "4 " + type.first + "4;\n";
        text += "#define make_" + type.first + "4 make_" + type.second + "4\n";
    }
    return text +
           "#define KERNEL extern \"C\" __global__\n#define DEVICE __device__\n#define LOCAL "
           "__shared__\n#define GLOBAL\n#define RESTRICT __restrict__\n#define LOCAL_ID "
           "threadIdx.x\n#define GLOBAL_ID (blockIdx.x*blockDim.x+threadIdx.x)\n#define "
           "GLOBAL_SIZE "
           "(blockDim.x*gridDim.x)\n#define GROUP_ID blockIdx.x\n#define NUM_GROUPS gridDim.x\n"
           "#define SYNC_THREADS __syncthreads();\ntypedef long long "
           "mm_long;\ntypedef unsigned long long mm_ulong;\n";
}

/** @param each  whether each scheme has each precision, and not one after the other */
void checkKernels(const Nvrtc& nvrtc, bool each) {
    int count = 0;
    for (auto scheme : thermostats()) {
        const int own = count++ % 3;
        for (int k : {0, 1, 2}) {
            if (!each && k != own) continue;
            const char* precision = array{"single", "mixed", "double"}[k];
            BodiesOnDevice bodies;
            bodies.scheme = scheme;
            bodies.slots = 32;
            bodies.bodySlots = 24;
            bodies.particles = 70;
            bodies.paddedParticles = 96;
            bodies.isPeriodic = bodies.isConstrained = string(precision) != "mixed";
            bodies.hasMomenta = scheme != CustomRigidHIIntegrator::GradientThermostat;
            const string source = prelude(precision) + programOf(bodies).whole();
            EXPECT_EQ(nvrtc.compile(source), "") << "scheme " << scheme << ", " << precision;
        }
    }
}

}  // namespace

/** Schemes have kernels of their own, and precisions types that all schemes share. */
TEST(KernelCompiles, ForEverySchemeAndForEveryPrecision) {
    const Nvrtc nvrtc;
    if (!nvrtc) GTEST_SKIP() << "NVRTC is not installed";
    checkKernels(nvrtc, false);
    EXPECT_NE(nvrtc.compile("KERNEL void nonsense("), "");
}
TEST(KernelCompiles, FullForEverySchemeInEveryPrecision) {
    const Nvrtc nvrtc;
    if (!nvrtc) GTEST_SKIP() << "NVRTC is not installed";
    checkKernels(nvrtc, true);
}

TEST(KernelCompiles, ForEveryKindOfProducts) {
    const Nvrtc nvrtc;
    if (!nvrtc) GTEST_SKIP() << "NVRTC is not installed";
    for (bool hasTorque : {false, true})
        for (bool hasWall : {false, true})
            for (const char* precision : {"single", "mixed", "double"})
                EXPECT_EQ(
                    nvrtc.compile(prelude(precision) + pairProgram({hasTorque, hasWall}).whole()),
                    "")
                    << hasTorque << " " << hasWall << " " << precision;
}

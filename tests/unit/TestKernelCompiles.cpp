// The compilers of CUDA and HIP take the kernels of bodies and of products, in each precision. They
// need no GPU. Where NVRTC or HIPRTC is not installed, the test is skipped.

#include <dlfcn.h>
#include <array>

#include "TestSupport.h"
#include "text/PairText.h"
#include "text/SchemeText.h"

using namespace RigidHIPlugin;
using namespace RigidHITest;
using namespace std;

namespace {

/** A compiler at run time, NVRTC or HIPRTC, whose functions are found when the test runs. */
class Compiler {
public:
    explicit Compiler(const string& name) : prefix(name) {
        const bool isCuda = name == "nvrtc";
        const vector<string> names =
            isCuda ? vector<string>{"libnvrtc.so", "/usr/local/cuda/lib64/libnvrtc.so",
                                    "libnvrtc.so.13", "libnvrtc.so.12", "libnvrtc.so.11.2"}
                   : vector<string>{"libhiprtc.so", "libhiprtc.so.6", "libamdhip64.so.5"};
        for (const string& each : names)
            if (!library) library = dlopen(each.c_str(), RTLD_NOW);
        // With the options that OpenMM's platforms give.
        options = isCuda ? vector<const char*>{"--use_fast_math", "--gpu-architecture=compute_80"}
                         : vector<const char*>{"-ffast-math", "--gpu-architecture=gfx90a"};
    }
    explicit operator bool() const { return library != nullptr; }
    /** @return errors; empty: it compiles */
    string compile(const string& source) const {
        void* program = nullptr;
        find<int(void**, const char*, const char*, int, const char* const*, const char* const*)>(
            "CreateProgram")(&program, source.c_str(), nullptr, 0, nullptr, nullptr);
        string log;
        if (find<int(void*, int, const char**)>("CompileProgram")(program, options.size(),
                                                                  options.data()) != 0) {
            size_t size = 0;
            find<int(void*, size_t*)>("GetProgramLogSize")(program, &size);
            log.resize(size);
            find<int(void*, char*)>("GetProgramLog")(program, &log[0]);
            if (log.empty()) log = "it did not compile";
        }
        find<int(void**)>("DestroyProgram")(&program);
        return log;
    }

private:
    template <class Function>
    Function* find(const string& name) const {
        return reinterpret_cast<Function*>(dlsym(library, (prefix + name).c_str()));
    }
    const string prefix;
    mutable vector<const char*> options;
    void* library = nullptr;
};

/** What OpenMM's platforms CUDA and HIP put before a program, as far as these kernels use it. */
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
void checkKernels(const Compiler& compiler, bool each) {
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
            EXPECT_EQ(compiler.compile(source), "") << "scheme " << scheme << ", " << precision;
        }
    }
}

}  // namespace

class KernelCompiles : public testing::TestWithParam<const char*> {
protected:
    void SetUp() override {
        if (!compiler) GTEST_SKIP() << GetParam() << " is not installed";
    }
    const Compiler compiler{GetParam()};
};
INSTANTIATE_TEST_SUITE_P(With, KernelCompiles, testing::Values("nvrtc", "hiprtc"),
                         [](const auto& info) { return string(info.param); });

/** Schemes have kernels of their own, and precisions types that all schemes share. */
TEST_P(KernelCompiles, ForEverySchemeAndForEveryPrecision) {
    checkKernels(compiler, false);
    EXPECT_NE(compiler.compile("KERNEL void nonsense("), "");
}
TEST_P(KernelCompiles, FullForEverySchemeInEveryPrecision) { checkKernels(compiler, true); }

TEST_P(KernelCompiles, ForEveryKindOfProducts) {
    for (bool hasTorque : {false, true})
        for (bool hasWall : {false, true})
            for (const char* precision : {"single", "mixed", "double"})
                EXPECT_EQ(compiler.compile(prelude(precision) +
                                           pairProgram({hasTorque, hasWall}).whole()),
                          "")
                    << hasTorque << " " << hasWall << " " << precision;
}

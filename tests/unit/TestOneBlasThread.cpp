// The number of BLAS threads belongs to the process. All holders of OneBlasThread share this
// number, and the last holder restores it.

#include <memory>

#include "TestSupport.h"
#include "linearalgebra/OneBlasThread.h"

extern "C" {
int openblas_get_num_threads();
void openblas_set_num_threads(int threads);
}

using RigidHIPlugin::OneBlasThread;
using namespace std;

namespace {

/** Sets two BLAS threads for a test, whatever the machine has, and restores the number afterwards.
 */
class TwoThreads : public testing::Test {
protected:
    void SetUp() override { openblas_set_num_threads(2); }
    void TearDown() override { openblas_set_num_threads(before); }
    const int before = openblas_get_num_threads();
};

using Holder = unique_ptr<OneBlasThread>;

}  // namespace

TEST_F(TwoThreads, AreOneWhileAnybodyHoldsThem) {
    for (bool firstLeavesFirst : {true, false}) {
        Holder first(new OneBlasThread());
        EXPECT_EQ(openblas_get_num_threads(), 1);
        Holder second(new OneBlasThread());
        EXPECT_EQ(openblas_get_num_threads(), 1);
        (firstLeavesFirst ? first : second).reset();
        EXPECT_EQ(openblas_get_num_threads(), 1) << "one of two left";
        (firstLeavesFirst ? second : first).reset();
        EXPECT_EQ(openblas_get_num_threads(), 2) << "both left";
    }
}

TEST_F(TwoThreads, ANumberThatIsSetMeanwhileStays) {
    Holder first(new OneBlasThread());
    openblas_set_num_threads(3);
    first.reset();
    EXPECT_EQ(openblas_get_num_threads(), 3);
    // The next holder gets its one thread again, and the last one restores what was set.
    openblas_set_num_threads(2);
    first = make_unique<OneBlasThread>();
    openblas_set_num_threads(3);
    Holder second(new OneBlasThread());
    EXPECT_EQ(openblas_get_num_threads(), 1);
    first.reset();
    EXPECT_EQ(openblas_get_num_threads(), 1);
    second.reset();
    EXPECT_EQ(openblas_get_num_threads(), 3);
}

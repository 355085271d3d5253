// A Context prints each of its warnings once.
#include <gtest/gtest.h>

#include <functional>

#include "context/WarningPrinter.h"

using namespace RigidHIPlugin;
using namespace std;

namespace {

string printedBy(const function<void()>& action) {
    testing::internal::CaptureStderr();
    action();
    return testing::internal::GetCapturedStderr();
}

string printedBy(WarningPrinter& printer, const Warnings& warnings) {
    return printedBy([&] { printer.print(warnings); });
}

TEST(WarningPrinter, PrintsEachCauseOnce) {
    WarningPrinter printer;
    EXPECT_EQ(printedBy(printer, {}), "");
    EXPECT_EQ(printedBy(printer, {{WarningCause::UnboundedFluid, "the box is 2 nm"}}),
              "Warning: CustomRigidHIIntegrator: the box is 2 nm\n");
    // Its numbers have changed, its cause has not.
    EXPECT_EQ(printedBy(printer, {{WarningCause::UnboundedFluid, "the box is 3 nm"},
                                  {WarningCause::BoxOfTheDefault, "default"},
                                  {WarningCause::ImagesAcross, "images"}}),
              "Warning: CustomRigidHIIntegrator: default\n"
              "Warning: CustomRigidHIIntegrator: images\n");
    WarningPrinter another;
    EXPECT_EQ(printedBy(another, {{WarningCause::UnboundedFluid, "the box is 3 nm"}}),
              "Warning: CustomRigidHIIntegrator: the box is 3 nm\n");
}

TEST(WarningPrinter, LeavesStepsToTheBeginningOfAStep) {
    WarningPrinter printer;
    const auto printedByStep = [&] { return printedBy([&] { printer.printWaiting(); }); };
    EXPECT_EQ(printedBy(printer, {{WarningCause::LongTurn, "turn"}}), "");
    EXPECT_EQ(printedByStep(), "Warning: CustomRigidHIIntegrator: turn\n");
    EXPECT_EQ(printedByStep(), "");
    EXPECT_EQ(printedBy(printer, {{WarningCause::LongTurn, "turn"}}), "");
    EXPECT_EQ(printedByStep(), "");
    // The user has changed the step before it was taken.
    EXPECT_EQ(printedBy(printer, {{WarningCause::LongDisplacement, "leap"}}), "");
    EXPECT_EQ(printedBy(printer, {}), "");
    EXPECT_EQ(printedByStep(), "");
}

TEST(WarningPrinter, LeavesTheBarostatToTheBeginningOfAStep) {
    WarningPrinter printer;
    EXPECT_EQ(printedBy(printer, {{WarningCause::BarostatTemperature, "another temperature"}}), "");
}

}  // namespace

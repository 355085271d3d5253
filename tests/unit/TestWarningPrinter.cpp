// A Context prints each of its warnings once.
#include <gtest/gtest.h>

#include "context/WarningPrinter.h"

using namespace RigidHIPlugin;
using namespace std;

namespace {

string printedBy(WarningPrinter& printer, const Warnings& warnings) {
    testing::internal::CaptureStderr();
    printer.print(warnings);
    return testing::internal::GetCapturedStderr();
}

TEST(WarningPrinter, PrintsEachCauseOnce) {
    WarningPrinter printer;
    EXPECT_EQ(printedBy(printer, {}), "");
    EXPECT_EQ(printedBy(printer, {{WarningCause::LargeFriction, "gamma is 200"}}),
              "Warning: CustomRigidHIIntegrator: gamma is 200\n");
    // Its numbers have changed, its cause has not.
    EXPECT_EQ(printedBy(printer, {{WarningCause::LargeFriction, "gamma is 300"},
                                  {WarningCause::OmittedDrift, "drift"},
                                  {WarningCause::LongTurn, "turn"}}),
              "Warning: CustomRigidHIIntegrator: drift\n"
              "Warning: CustomRigidHIIntegrator: turn\n");
    WarningPrinter another;
    EXPECT_EQ(printedBy(another, {{WarningCause::LargeFriction, "gamma is 300"}}),
              "Warning: CustomRigidHIIntegrator: gamma is 300\n");
}

TEST(WarningPrinter, LeavesTheBarostatToTheBeginningOfAStep) {
    WarningPrinter printer;
    EXPECT_EQ(printedBy(printer, {{WarningCause::BarostatTemperature, "another temperature"}}), "");
}

}  // namespace

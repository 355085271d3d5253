#include "context/WarningPrinter.h"

#include <iostream>

#include "context/FluidMismatches.h"
#include "context/MemberMismatches.h"
#include "context/Mismatches.h"
#include "context/Scene.h"

using namespace std;

namespace RigidHIPlugin {

namespace {

/** The causes that do harm in steps alone. */
const set<WarningCause> causesOfSteps = {
    WarningCause::OmittedDrift,       WarningCause::UnresolvedRotation,
    WarningCause::LargeFriction,      WarningCause::DriftFactorSpread,
    WarningCause::LongDisplacement,   WarningCause::LongTurn,
    WarningCause::StiffForces,        WarningCause::LongDrive,
    WarningCause::ShortStep,          WarningCause::StrainOfFlow,
    WarningCause::SpinUnderLangevinA, WarningCause::DrivenSpin,
    WarningCause::FastRelaxation,     WarningCause::ManyRejections,
    WarningCause::MatricesByColumns,  WarningCause::WrongTemperature};

}  // namespace

void WarningPrinter::print(const Warnings& warnings) {
    waiting.clear();  // other settings may have removed their causes
    for (const auto& warning : warnings)
        if (causesOfSteps.count(warning.first) > 0)
            waiting.insert(warning);
        else if (warning.first != WarningCause::BarostatTemperature)
            printOnce(warning.first, warning.second);
}

void WarningPrinter::printWaiting() {
    for (const auto& warning : waiting) printOnce(warning.first, warning.second);
    waiting.clear();
}

void WarningPrinter::printOfSteps(const Scene& scene) {
    if (!stepsHaveWarnings(scene, printed)) return;
    print(findWarnings(scene));
    printWaiting();
}

void WarningPrinter::printOfBarostat(const Scene& scene) {
    if (scene.stock.barostat.empty() || printed.count(WarningCause::BarostatTemperature) > 0)
        return;
    const string text = barostatAtAnotherTemperature(scene);
    if (!text.empty()) printOnce(WarningCause::BarostatTemperature, text);
}

void WarningPrinter::printOfFluid(const Scene& scene) {
    const MobilityForce* changed = scene.fluid.getChanged();
    if (!changed || changed->getSettingsVersion() == comparedFluid ||
        printed.count(WarningCause::FluidWithoutUpdate) > 0)
        return;
    comparedFluid = changed->getSettingsVersion();
    const string text = fluidWithoutUpdate(scene);
    if (!text.empty()) printOnce(WarningCause::FluidWithoutUpdate, text);
}

void WarningPrinter::printOfPositions(const Scene& scene) {
    Warnings warnings;
    addMismatchesOfPositions(scene, warnings);
    addMismatchesOfMembers(scene, warnings);
    addMismatchesOfPlaces(scene, warnings);
    print(warnings);
}

void WarningPrinter::printOnce(WarningCause cause, const string& text) {
    if (printed.insert(cause).second) cerr << "Warning: CustomRigidHIIntegrator: " << text << endl;
}

}  // namespace RigidHIPlugin

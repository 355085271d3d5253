#include "context/WarningPrinter.h"

#include <iostream>

#include "context/Mismatches.h"
#include "context/Scene.h"

using namespace std;

namespace RigidHIPlugin {

void WarningPrinter::print(const Warnings& warnings) {
    for (const auto& warning : warnings)
        if (warning.first != WarningCause::BarostatTemperature)
            printOnce(warning.first, warning.second);
}

void WarningPrinter::printOfSteps(const Scene& scene) {
    if (stepsHaveWarnings(scene, printed)) print(findWarnings(scene));
}

void WarningPrinter::printOfBarostat(const Scene& scene) {
    if (scene.stock.barostat.empty() || printed.count(WarningCause::BarostatTemperature) > 0)
        return;
    const string text = barostatAtAnotherTemperature(scene);
    if (!text.empty()) printOnce(WarningCause::BarostatTemperature, text);
}

void WarningPrinter::printOfPositions(const Scene& scene) {
    Warnings warnings;
    addMismatchesOfPositions(scene, warnings);
    print(warnings);
}

void WarningPrinter::printOnce(WarningCause cause, const string& text) {
    if (printed.insert(cause).second) cerr << "Warning: CustomRigidHIIntegrator: " << text << endl;
}

}  // namespace RigidHIPlugin

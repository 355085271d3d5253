#ifndef RIGIDHI_WARNING_PRINTER_H_
#define RIGIDHI_WARNING_PRINTER_H_

#include <set>
#include <string>

#include "context/Warnings.h"

namespace RigidHIPlugin {

/** Prints the warnings of a Context, each cause once. */
class WarningPrinter {
public:
    /**
     * Print these warnings if they are new, except about a barostat (printOfBarostat()). Warnings
     * about steps wait until a step begins, because some users ask for matrices and flows alone.
     */
    void print(const Warnings& warnings);
    /** Print the warnings that wait for a step. Call this when a step begins. */
    void printWaiting();
    /** Print the warnings for which the steps so far give a reason. Call this now and then. */
    void printOfSteps(const Scene& scene);
    /**
     * Print the warning about a barostat's temperature. Call this when a step begins, because
     * between steps users set one temperature after the other.
     */
    void printOfBarostat(const Scene& scene);
    /** Print the warning about settings of a MobilityForce that the Context does not have. */
    void printOfFluid(const Scene& scene);
    /** Print the warnings that depend on positions. Call this when the first step begins. */
    void printOfPositions(const Scene& scene);

private:
    void printOnce(WarningCause cause, const std::string& text);
    int comparedFluid = -1;  // version of its settings
    std::set<WarningCause> printed;
    Warnings waiting;
};

}  // namespace RigidHIPlugin

#endif

#ifndef RIGIDHI_WARNING_PRINTER_H_
#define RIGIDHI_WARNING_PRINTER_H_

#include <set>
#include <string>

#include "context/Warnings.h"

namespace RigidHIPlugin {

/** Prints the warnings of a Context, each cause once. */
class WarningPrinter {
public:
    /** Print the new ones among these. A barostat's temperature is left to printOfBarostat(). */
    void print(const Warnings& warnings);
    /** Print what the steps so far give reason for. To be called now and then. */
    void printOfSteps(const Scene& scene);
    /**
     * Print the warning about a barostat's temperature. To be called when a step begins: between
     * steps users set one temperature after the other.
     */
    void printOfBarostat(const Scene& scene);

private:
    void printOnce(WarningCause cause, const std::string& text);
    std::set<WarningCause> printed;
};

}  // namespace RigidHIPlugin

#endif

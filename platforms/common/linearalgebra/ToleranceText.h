#ifndef RIGIDHI_TOLERANCE_TEXT_H_
#define RIGIDHI_TOLERANCE_TEXT_H_

#include <sstream>
#include <string>

namespace RigidHIPlugin {

/**
 * The text of a tolerance in a message: the tolerance that the user has set, and the part of it for
 * an iteration.
 *
 * @param tolerance  that of the iteration
 * @param wanted  that of the user; 0: the iteration's own tolerance is the user's
 */
inline std::string toleranceText(double tolerance, double wanted) {
    std::ostringstream text;
    text << "the tolerance of " << (wanted > 0 ? wanted : tolerance);
    if (wanted > 0 && wanted != tolerance)
        text << ", of which an iteration may take " << tolerance << ",";
    return text.str();
}

}  // namespace RigidHIPlugin

#endif

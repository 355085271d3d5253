#ifndef RIGIDHI_GRID_CHECKS_H_
#define RIGIDHI_GRID_CHECKS_H_

#include <string>

#include "mobility/models/forcecoupling/GridShape.h"

namespace RigidHIPlugin {

/**
 * Refuse something that a model on a grid cannot do.
 *
 * @throws OpenMMException always
 */
[[noreturn]] void refuseGrid(const std::string& model, const std::string& problem);
/**
 * @param mayLean  whether the model supports triclinic boxes
 * @throws OpenMMException  without a box, or for a triclinic box that the model does not support
 */
void checkBoxOfGrid(const std::string& model, const BoxVectors& box, bool mayLean = false);
/** @throws OpenMMException  for more nodes along an edge than the numbers of modes allow */
void checkSizeOfGrid(const std::string& model, const BoxVectors& box, double spacing);
/**
 * @param bytes  that the model needs for this grid
 * @param held   of these, the bytes that the model already holds
 * @param also   what needs memory besides nodes, for the message
 * @throws OpenMMException  if the machine lacks this free memory
 */
void checkMemoryOfGrid(const std::string& model, const GridShape& shape, double bytes, double held,
                       const std::string& also = "");
/**
 * For models that also sum over pairs; a coarser grid leaves more pairs.
 *
 * @param neighbours  average number of neighbours of a particle
 * @param gap         largest gap between the surfaces of neighbours, nm
 * @param bytes       that grid and pairs need
 * @param held        of these, the bytes that the model already holds
 * @throws OpenMMException  if the machine lacks this free memory
 */
void checkMemoryOfPairs(const std::string& model, double neighbours, double gap, double bytes,
                        double held);

}  // namespace RigidHIPlugin

#endif

#ifndef RIGIDHI_GRID_CHECKS_H_
#define RIGIDHI_GRID_CHECKS_H_

#include <string>

#include "mobility/models/forcecoupling/GridShape.h"

namespace RigidHIPlugin {

/** Says that a model on a grid cannot do something. @throws OpenMMException always */
[[noreturn]] void refuseGrid(const std::string& model, const std::string& problem);
/**
 * @param mayLean  whether the model takes triclinic boxes
 * @throws OpenMMException  for a box that is none, or that leans though it may not
 */
void checkBoxOfGrid(const std::string& model, const BoxVectors& box, bool mayLean = false);
/** @throws OpenMMException  for more nodes along an edge than numbers of modes can be told apart */
void checkSizeOfGrid(const std::string& model, const BoxVectors& box, double spacing);
/**
 * @param bytes  that the model takes for this grid
 * @param held   those of them that it has already
 * @throws OpenMMException  if the machine does not have them free
 */
void checkMemoryOfGrid(const std::string& model, const GridShape& shape, double bytes, double held);
/**
 * For models that also sum over pairs, of which a coarser grid leaves more.
 *
 * @param neighbours  of a particle, on average
 * @param gap         between the surfaces of neighbours, at most, in nm
 * @param bytes       that grid and pairs take
 * @param held        those of them that the model has already
 * @throws OpenMMException  if the machine does not have them free
 */
void checkMemoryOfPairs(const std::string& model, double neighbours, double gap, double bytes,
                        double held);

}  // namespace RigidHIPlugin

#endif

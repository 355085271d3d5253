#ifndef RIGIDHI_MODEL_FACETS_H_
#define RIGIDHI_MODEL_FACETS_H_

#include <memory>
#include <string>

#include "mobility/GridSeconds.h"
#include "mobility/MobilityAt.h"
#include "mobility/RandomField.h"
#include "random/CounterNoise.h"

namespace RigidHIPlugin {

// Optional parts of a model. A MobilityModel returns a pointer to each, null where the model lacks
// it.

/** The periodic box of a model (MobilityModel::box()). */
class BoxOfModel {
public:
    virtual ~BoxOfModel() {}
    /**
     * @throws OpenMMException  if the model does not support the box. The message names the box and
     *     the remedy. Default: the model accepts every box.
     */
    virtual void check(const BoxVectors& box) const {}
    /**
     * The volume of the fluid in the box, nm^3; only the part between walls counts. Because M is
     * symmetric, the flow of sources contains a wave sin(kx) along the direction a with the
     * amplitude 2/(eta k^2 V) times the power of the sources on a flow of unit amplitude.
     */
    virtual double volume(const BoxVectors& box) const = 0;
    /**
     * @throws OpenMMException if the box and the model allow no wave of so many periods along an
     *     axis, because the wave would not be periodic or is too short for the grid
     */
    virtual void checkWave(const BoxVectors& box, int axis, int periods) const = 0;
};

/** The grid on which a model solves for the flow (MobilityModel::grid()). */
class GridOfModel {
public:
    virtual ~GridOfModel() {}
    /** A description of the grid in a box, for describeEffects(). */
    virtual std::string describe(const BoxVectors& box) const = 0;
    /** The time that the grid has taken so far, together with models that share it. */
    virtual GridSeconds getSeconds() const = 0;
};

/**
 * Random fields of a model (MobilityModel::randomField()): noise that costs less than square roots
 * of M. A model without random fields needs square roots.
 */
class FieldOfModel {
public:
    virtual ~FieldOfModel() {}
    /**
     * Whether the velocity that a particle takes from a field depends on its own position only, so
     * that the field is one flow. If not, the velocities at each placement still have the
     * covariance M there, but divergences need the method for square roots of M.
     */
    virtual bool isLocal() const = 0;
    /**
     * Draw a field.
     *
     * @param purpose  of the random numbers; with the noise's seed and step it determines the
     *     numbers
     * @param field  that of an earlier draw of this model, whose memory is reused, or null
     */
    virtual void draw(const NoiseStream& noise, uint32_t purpose, const BoxVectors& box,
                      std::unique_ptr<RandomField>& field) const = 0;
};

}  // namespace RigidHIPlugin

#endif

#ifndef RIGIDHI_MOBILITY_DECORATOR_H_
#define RIGIDHI_MOBILITY_DECORATOR_H_

#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "mobility/MobilityModel.h"

namespace RigidHIPlugin {

/**
 * A model that changes the mobility of another model of the same particles, and is otherwise like
 * the other model. Derived classes override what they change. A random field of the other model
 * would have the covariance of that model, so a decorator has none.
 */
class MobilityDecorator : public MobilityModel {
public:
    /** @param traits  those of the other model, changed where this model differs */
    MobilityDecorator(const HydrodynamicParticles& particles, double viscosity,
                      const MobilityTraits& traits, std::unique_ptr<MobilityModel>&& model)
        : MobilityModel(particles, viscosity, traits), model(std::move(model)) {}
    /** The other model. */
    const MobilityModel& getModel() const { return *model; }

    std::string objection(const Placement& placement) const override {
        return model->objection(placement);
    }
    OpenMM::Vec3 placeInFormulas(int particle, const OpenMM::Vec3& position) const override {
        return model->placeInFormulas(particle, position);
    }
    double weightInFormulas(int particle, const OpenMM::Vec3& position) const override {
        return model->weightInFormulas(particle, position);
    }
    WaveFactors waveFactors(double radius, double k) const override {
        return model->waveFactors(radius, k);
    }
    std::string describeLubrication() const override { return model->describeLubrication(); }
    const BoxOfModel* box() const override { return model->box(); }
    const GridOfModel* grid() const override { return model->grid(); }
    bool hasFastProducts(double error) const override { return model->hasFastProducts(error); }
    std::string describeFastProducts(double error) const override {
        return model->describeFastProducts(error);
    }
    void ownMobility(const HydrodynamicParticles& body, const std::vector<OpenMM::Vec3>& sites,
                     Eigen::MatrixXd& mobility) const override {
        model->ownMobility(body, sites, mobility);
    }
    std::unique_ptr<MobilityModel> forCollectiveModes(
        const HydrodynamicParticles& spheres) const override {
        return model->forCollectiveModes(spheres);
    }

private:
    const std::unique_ptr<MobilityModel> model;
};

}  // namespace RigidHIPlugin

#endif

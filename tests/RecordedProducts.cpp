#include "RecordedProducts.h"

#include <openmm/KernelFactory.h>

#include <algorithm>
#include <cmath>
#include <sstream>

#include "TestSupport.h"
#include "context/ReferenceArrays.h"
#include "host/ScalarLoops.h"
#include "kernel/RigidBodyKernel.h"
#include "mobility/NearAndFar.h"
#include "mobility/models/rotneprager/RotnePragerYamakawa.h"

using namespace OpenMM;
using namespace RigidHIPlugin;
using namespace std;
using Eigen::MatrixXd;

namespace RigidHITest {

vector<string> productsAskedFor;

namespace {

void record(const char* kind, double error) {
    ostringstream text;
    text.precision(2);
    text << kind << error;
    if (find(productsAskedFor.begin(), productsAskedFor.end(), text.str()) ==
        productsAskedFor.end())
        productsAskedFor.push_back(text.str());
}

/** Exact products, whatever error they may have. */
class RecordingPlace : public MobilityAt {
public:
    explicit RecordingPlace(const MobilityModel& model)
        : MobilityAt(model), plain(model.getParticles(), model.getViscosity()) {}
    void multiply(const MatrixXd& forces, MatrixXd& velocities, const Accuracy& accuracy) override {
        record(accuracy.purpose == Accuracy::Difference ? "d" : "", accuracy.error);
        const int rows = particles.numRows;
        at->multiply(forces.topRows(rows), ofParticles);
        velocities = forces;  // stresslets have a mobility of 1, by themselves
        velocities.topRows(rows) = ofParticles;
    }

protected:
    void moveTo(const Placement& placement, bool) override { plain.place(at, placement); }

private:
    const RotnePragerYamakawa plain;
    unique_ptr<MobilityAt> at;
    MatrixXd ofParticles;
};

/** Products that are iterations, as with lubrication, but no particles are near each other. */
class IteratingPlace : public MobilityAt, public NearAndFar {
public:
    explicit IteratingPlace(const MobilityModel& model) : MobilityAt(model), farPart(model) {}
    void multiply(const MatrixXd& forces, MatrixXd& velocities, const Accuracy& accuracy) override {
        record("s", accuracy.error);
        farPart.multiply(forces, velocities, Accuracy());
    }
    void dense(MatrixXd& mobility) override { farPart.dense(mobility); }
    NearAndFar* parts() override { return this; }
    MobilityAt& far() override { return farPart; }
    void addNear(const MatrixXd&, double, MatrixXd&) override {}
    long long addNearNoise(const NoiseStream&, uint32_t, MatrixXd&) override { return 0; }
    void solve(double tolerance, MatrixXd&) override { record("s", tolerance); }
    void solve(double tolerance, const MatrixXd& forces, const MatrixXd& slips,
               MatrixXd& velocities, MatrixXd& farForces) override {
        record("s", tolerance);
        const int rows = particles.numRows, rowsOfFar = rows + 5 * particles.size();
        farPart.multiply(forces, velocities, Accuracy());
        farForces.setZero(rowsOfFar, forces.cols());
        farForces.topRows(rows) = forces;
        if (slips.size() == 0) return;
        velocities += slips.topRows(rows);
        farForces.bottomRows(rowsOfFar - rows) = -slips.bottomRows(rowsOfFar - rows);
    }
    long long getNumProducts() const override { return 0; }
    long long getNumIterations() const override { return 0; }

protected:
    void moveTo(const Placement& placement, bool nearby) override {
        farPart.moveTo(placement, nearby);
    }

private:
    struct Far : RecordingPlace {
        using RecordingPlace::moveTo;
        using RecordingPlace::RecordingPlace;
    };
    Far farPart;
};

/** A flow that changes in space, with random phases. */
class RecordingField : public RandomField {
public:
    explicit RecordingField(const HydrodynamicParticles& particles) : particles(particles) {}
    void draw(const NoiseStream& noise, uint32_t purpose) {
        noise.pair(purpose, 0, 0, phases[0], phases[1]);
        noise.pair(purpose, 1, 0, phases[2], phases[3]);
    }
    void slipsAt(const Placement& placement, bool, MatrixXd& slips) override {
        slips.setZero(particles.numRows + (withStresslets ? 5 * particles.size() : 0), 1);
        for (int i = 0; i < particles.size(); i++) {
            const Vec3& x = placement.positions[i];
            const int row = particles.firstRow[i];
            for (int k = 0; k < 3; k++) {
                const int next = (k + 1) % 3;
                slips(row + k, 0) = sin(x[next] + phases[k]);
                if (particles.hasTorque[i])  // half the curl
                    slips(row + 3 + (k + 2) % 3, 0) = -0.5 * cos(x[next] + phases[k]);
            }
        }
    }
    void addFlowAt(const vector<Vec3>&, double, Velocities&) override {}
    double amplitudeOf(const DrivenFlow&) override { return 0; }
    long long getNumRandomNumbers() const override { return 4; }
    bool withStresslets = false;

private:
    const HydrodynamicParticles& particles;
    double phases[4];
};

class RecordingModel : public MobilityModel, public FieldOfModel {
public:
    RecordingModel(const Kind& kind, const HydrodynamicParticles& particles, double viscosity)
        : MobilityModel(particles, viscosity, traitsOf(kind)), kind(kind) {}
    bool hasFastProducts(double error) const override { return kind.hasFast && error >= 1e-7; }
    string describeFastProducts(double error) const override {
        ostringstream text;
        text.precision(2);
        text << "with errors of " << error;
        return error > 0 ? text.str() : string();
    }
    const FieldOfModel* randomField() const override {
        return kind.noise == Kind::Roots ? nullptr : this;
    }
    bool isLocal() const override { return kind.noise == Kind::LocalField; }
    void draw(const NoiseStream& noise, uint32_t purpose, const BoxVectors&,
              unique_ptr<RandomField>& field) const override {
        if (!field) field = make_unique<RecordingField>(particles);
        RecordingField& own = static_cast<RecordingField&>(*field);
        own.withStresslets = traits.slipsOfParts;
        own.draw(noise, purpose);
    }

protected:
    unique_ptr<MobilityAt> makePlace() const override {
        if (traits.productsIterate) return make_unique<IteratingPlace>(*this);
        return make_unique<RecordingPlace>(*this);
    }

private:
    const Kind kind;

    static MobilityTraits traitsOf(const Kind& kind) {
        MobilityTraits traits(kind.name);
        traits.isIsotropic = true;
        traits.isDivergenceFree = kind.isDivergenceFree;
        traits.hasSinglePrecision = kind.hasSingle;
        traits.hasFastSinglePrecision = kind.hasFastSingle;
        traits.productsIterate = traits.isMadeFromFriction = kind.products != Kind::Direct;
        traits.slipsOfParts = kind.products == Kind::IterateInParts;
        return traits;
    }
};

class RecordingLoops : public ScalarLoops {
public:
    explicit RecordingLoops(const Kind& kind) : kind(kind) {}
    unique_ptr<MobilityModel> createMobility(const MobilityForce& force, const MobilityScene&,
                                             const HydrodynamicParticles& particles,
                                             bool) override {
        return make_unique<RecordingModel>(kind, particles, force.getViscosity());
    }

private:
    const Kind kind;
};

class RecordingFactory : public KernelFactory {
public:
    explicit RecordingFactory(const Kind& kind) : kind(kind) {}
    KernelImpl* createKernelImpl(string name, const Platform& platform,
                                 ContextImpl&) const override {
        const Kind ofLoops = kind;
        PlatformParts parts;
        parts.arrays = [](ContextImpl& context) { return make_unique<ReferenceArrays>(context); };
        parts.loops = [ofLoops](ContextImpl&) { return make_unique<RecordingLoops>(ofLoops); };
        return new RigidBodyKernel(name, platform, parts);
    }

private:
    const Kind kind;
};

}  // namespace

unique_ptr<MobilityModel> recordingModel(const Kind& kind, const HydrodynamicParticles& particles,
                                         double viscosity) {
    return make_unique<RecordingModel>(kind, particles, viscosity);
}

RecordingPlatform::RecordingPlatform(const Kind& kind) {
    platform("Reference");  // loads the library, which needs a platform for its kernels
    registerKernelFactory(IntegrateRigidBodiesKernel::Name(), new RecordingFactory(kind));
}

}  // namespace RigidHITest

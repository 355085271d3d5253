#include "mobility/models/wall/SphereWall.h"

#include <openmm/OpenMMException.h>

#include <cmath>

using namespace std;

namespace RigidHIPlugin {

namespace {

/**
 * A resistance function of one sphere: start + pole/gap + u^power (sum_k powers_k u^k + ln(1 - u)
 * sum_k logarithms_k (1 - u)^k), with exact leading terms at both ends.
 * tools/sphere_wall_mobility.py makes the numbers. The errors given below are those between the
 * points of the fit.
 */
struct ResistanceFit {
    double start, pole;
    int power;
    array<double, 10> powers;
    array<double, 4> logarithms;

    double operator()(double gap) const {
        const double u = 1 / (1 + gap), rest = gap * u;
        double sum = 0, logarithmic = 0;
        for (size_t k = powers.size(); k-- > 0;) sum = sum * u + powers[k];
        for (size_t k = logarithms.size(); k-- > 0;)
            logarithmic = logarithmic * rest + logarithms[k];
        return start + pole / gap + pow(u, power) * (sum + log(rest) * logarithmic);
    }
};

/** Force from moving along the wall over 6 pi eta a; relative error 4e-9. */
const ResistanceFit moving = {
    1,
    0,
    1,
    {0.5625, -2.50413843293, 3.24613243634, -1.55094535568, 0.22687668775, -0.0368669722395,
     -0.0392193581998, 0.0852621098334, -0.0469063274578, 0.0115989906837},
    {-8.0 / 15, -0.703929326209, -0.850214077053, -0.733072984524}};
/** Torque from moving over 8 pi eta a^2; error 2e-7 of its largest value. */
const ResistanceFit coupling = {
    0,
    0,
    4,
    {-0.09375, 5.4303645829, -10.2019277675, 5.76008087791, -0.465724313095, -0.351245155238,
     0.369699585537, -0.442671296769, 0.268857229337, -0.0807313098384},
    {0.1, 0.571602442913, 1.8211001125, 2.90261891978}};
/** Torque from rotation about an axis along the wall over 8 pi eta a^3; relative error 2e-8. */
const ResistanceFit turning = {
    1,
    0,
    3,
    {0.3125, -13.8041835667, 25.222347999, -14.0195572787, 0.760276115961, 1.93928653647,
     -2.64208373715, 2.73365557553, -1.52384269531, 0.392493887677},
    {-0.4, -1.72755541093, -4.61583996735, -7.06183688695}};
/** Torque from rotation about the normal over 8 pi eta a^3; relative error 3e-8. */
const ResistanceFit spinning = {
    1,
    0,
    3,
    {0.125, 7.49681414384, -15.3816831936, 9.08861254337, -0.338471643427, -1.88011217181,
     2.66923835405, -2.6760618356, 1.46557270717, -0.36685213772},
    {0, 0.499737181655, 2.3429770614, 4.65521588051}};

/** Force from moving towards the wall over 6 pi eta a; relative error 8e-10 for gaps from 1e-6 to
 * 1e3. */
const ResistanceFit approaching = {
    1,
    1,
    1,
    {0.125, -0.520967794739, 0.533158498767, -0.249469445393, 0.183655099606, -0.109886234973,
     -0.0277442602601, 0.05160059398, -0.00955507334377, -0.00451062312776},
    {-0.2, -0.247288328454, -0.262564991369, -0.0767399741612}};

using Matrix2 = array<array<double, 2>, 2>;

/**
 * The square root of a symmetric positive definite matrix, by the Cayley-Hamilton theorem: (A +
 * sqrt(det A))/sqrt(tr A + 2 sqrt(det A)).
 */
Matrix2 squareRoot(double a, double b, double c) {
    const double s = sqrt(a * c - b * b), t = sqrt(a + c + 2 * s);
    return {{{(a + s) / t, b / t}, {b / t, (c + s) / t}}};
}

}  // namespace

SphereWallMobility SphereWallMobility::rotnePragerYamakawa(double u) {
    const double u3 = u * u * u, u5 = u3 * u * u;
    SphereWallMobility m;
    m.along = 1 - 9 * u / 16 + u3 / 8 - u5 / 16;
    m.across = 1 - 9 * u / 8 + u3 / 2 - u5 / 8;
    m.turnAlong = 0.75 * (1 - 5 * u3 / 16);
    m.turnNormal = 0.75 * (1 - u3 / 8);
    m.rolling = 3 * u3 * u / 32;
    return m;
}

SphereWallMobility SphereWallMobility::bestKnown(double gap) {
    const double tt = moving(gap), rt = coupling(gap), rr = turning(gap);
    const double determinant = tt * rr - 4 * rt * rt / 3;
    SphereWallMobility m;
    m.along = rr / determinant;
    m.across = 1 / approaching(gap);
    m.turnAlong = 0.75 * tt / determinant;
    m.rolling = -rt / determinant;
    m.turnNormal = 0.75 / spinning(gap);
    return m;
}

namespace {

bool isSingleSphere(const HydrodynamicParticles& particles, int i) {
    return particles.hasTorque[i] || particles.body[i] < 0;
}

/**
 * B of a particle. `along` acts on V_x and a W_y, or on F_x and T_y/a; other components as in
 * SphereWallMobility.
 */
struct Factor {
    double across = 1, turnNormal = 1;
    double along[2][2] = {{1, 0}, {0, 1}};
};

Factor factorAt(double gap, bool withTorque) {
    const SphereWallMobility best = SphereWallMobility::bestKnown(gap),
                             model = SphereWallMobility::rotnePragerYamakawa(1 / (1 + gap));
    Factor B;
    B.across = sqrt(best.across / model.across);
    if (!withTorque) {
        B.along[0][0] = sqrt(best.along / model.along);
        return B;
    }
    B.turnNormal = sqrt(best.turnNormal / model.turnNormal);
    const double determinant = model.along * model.turnAlong - model.rolling * model.rolling;
    const Matrix2 root = squareRoot(best.along, best.rolling, best.turnAlong),
                  inverse = squareRoot(model.turnAlong / determinant, -model.rolling / determinant,
                                       model.along / determinant);
    for (int i = 0; i < 2; i++)
        for (int k = 0; k < 2; k++)
            B.along[i][k] = root[i][0] * inverse[0][k] + root[i][1] * inverse[1][k];
    return B;
}

class SphereWallCongruenceAt : public MobilityAt {
public:
    SphereWallCongruenceAt(const SphereWallCongruence& congruence, const NoSlipPlane& wall,
                           const MobilityModel& model)
        : MobilityAt(congruence), wall(wall), model(model), factors(particles.size()) {}
    /**
     * B is a smooth function of the positions, so differences of products are as accurate as those
     * of the model.
     */
    void multiply(const Eigen::MatrixXd& forces, Eigen::MatrixXd& velocities,
                  const Accuracy& accuracy) override;
    void dense(Eigen::MatrixXd& mobility) override;
    void addStressletsOf(const DrivenFlow& flow, Eigen::MatrixXd& slips) override;
    FlowSources sources(const Eigen::MatrixXd& forces, const DrivenFlow* flow,
                        const Accuracy& accuracy) override;
    void addFlowAt(const FlowSources& sources, const vector<OpenMM::Vec3>& points, double factor,
                   Velocities& velocities) override {
        FlowSources inModel = sources;
        multiplyByFactors(inModel.forces, true);
        inner->addFlowAt(inModel, points, factor, velocities);
    }
    double getSecondsOfGrid() const override { return inner ? inner->getSecondsOfGrid() : 0; }

protected:
    void moveTo(const Placement& placement, bool nearby) override;

private:
    /** rows -> B rows, or B^T rows. */
    template <class Rows>
    void multiplyByFactors(Rows&& rows, bool transposed) const;

    const NoSlipPlane& wall;
    const MobilityModel& model;
    unique_ptr<MobilityAt> inner;
    vector<Factor> factors;
    Eigen::MatrixXd scaled;
};

void SphereWallCongruenceAt::moveTo(const Placement& placement, bool nearby) {
    if (nearby)
        model.placeNear(inner, placement);
    else
        model.place(inner, placement);
    for (int i = 0; i < particles.size(); i++)
        if (isSingleSphere(particles, i)) {
            const double radius = particles.radii[i], z = placement.positions[i][2];
            factors[i] =
                factorAt((wall.heightOver(z, radius) - radius) / radius, particles.hasTorque[i]);
        }
}

template <class Rows>
void SphereWallCongruenceAt::multiplyByFactors(Rows&& rows, bool transposed) const {
    for (int i = 0; i < particles.size(); i++) {
        if (!isSingleSphere(particles, i)) continue;
        const Factor& B = factors[i];
        const int row = particles.firstRow[i];
        const double a = particles.radii[i];
        for (int c = 0; c < rows.cols(); c++) {
            auto column = rows.col(c);
            column[row + 2] *= B.across;
            if (!particles.hasTorque[i]) {
                column[row] *= B.along[0][0];
                column[row + 1] *= B.along[0][0];
                continue;
            }
            column[row + 5] *= B.turnNormal;
            // B couples V with a W, and F with T/a. In V and W its off-diagonal entries therefore
            // contain a length.
            const double up = transposed ? B.along[1][0] / a : B.along[0][1] * a;
            const double down = transposed ? B.along[0][1] * a : B.along[1][0] / a;
            for (int k = 0; k < 2; k++) {
                const double sign = k == 0 ? 1 : -1;
                double &straight = column[row + k], &turn = column[row + 4 - k];
                const double s = straight, t = turn;
                straight = B.along[0][0] * s + sign * up * t;
                turn = sign * down * s + B.along[1][1] * t;
            }
        }
    }
}

void SphereWallCongruenceAt::multiply(const Eigen::MatrixXd& forces, Eigen::MatrixXd& velocities,
                                      const Accuracy& accuracy) {
    scaled = forces;
    multiplyByFactors(scaled, true);
    inner->multiply(scaled, velocities, accuracy);
    multiplyByFactors(velocities, false);
}

void SphereWallCongruenceAt::addStressletsOf(const DrivenFlow& flow, Eigen::MatrixXd& slips) {
    scaled.setZero(slips.rows(), slips.cols());
    inner->addStressletsOf(flow, scaled);
    multiplyByFactors(scaled, false);
    slips += scaled;
}

/** The sources keep the unscaled forces, because addFlowAt() scales them. */
FlowSources SphereWallCongruenceAt::sources(const Eigen::MatrixXd& forces, const DrivenFlow* flow,
                                            const Accuracy& accuracy) {
    scaled = forces;
    multiplyByFactors(scaled, true);
    FlowSources result = inner->sources(scaled, flow, accuracy);
    result.forces = forces;
    return result;
}

void SphereWallCongruenceAt::dense(Eigen::MatrixXd& mobility) {
    inner->dense(mobility);
    multiplyByFactors(mobility, false);
    auto columns = mobility.transpose();
    multiplyByFactors(columns, false);
    mobility.triangularView<Eigen::StrictlyUpper>() = mobility.transpose();
}

}  // namespace

namespace {

/**
 * Traits of the model with the factors B, which depend only on the heights of spheres above the
 * wall. The friction comes from the matrix. The model has no random field, because a field would
 * have the covariance M of the other model.
 */
MobilityTraits withFactors(MobilityTraits traits) {
    traits.mayObject = true;
    traits.holdsNearby = false;
    traits.isHomogeneous = traits.isIsotropic = traits.isDivergenceFree = false;
    traits.isMadeFromFriction = false;
    return traits;
}

}  // namespace

SphereWallCongruence::SphereWallCongruence(const HydrodynamicParticles& particles, double viscosity,
                                           const NoSlipPlane& wall, const char* boundary,
                                           unique_ptr<MobilityModel> model)
    : MobilityDecorator(particles, viscosity, withFactors(model->getTraits()), move(model)),
      wall(wall), boundary(boundary) {}

string SphereWallCongruence::objection(const Placement& placement) const {
    const string problem = getModel().objection(placement);
    if (!problem.empty()) return problem;
    const vector<OpenMM::Vec3>& positions = placement.positions;
    for (int i = 0; i < particles.size(); i++)
        if (isSingleSphere(particles, i) &&
            !(wall.heightOver(positions[i][2], particles.radii[i]) > particles.radii[i]))
            return string(boundary) + ": " + particleAndBody(particles, i) +
                   " touches the wall, where sphere-wall mobility BestKnown lets no sphere move; "
                   "move it up, use smaller time steps, or use setSphereWallMobility(FromModel)";
    return {};
}

unique_ptr<MobilityAt> SphereWallCongruence::makePlace() const {
    return make_unique<SphereWallCongruenceAt>(*this, wall, getModel());
}

}  // namespace RigidHIPlugin

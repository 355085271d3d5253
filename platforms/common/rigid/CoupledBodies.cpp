#include "rigid/CoupledBodies.h"

#include <openmm/OpenMMException.h>

#include <sstream>

#include "linearalgebra/CholeskyFactor.h"
#include "linearalgebra/Decompositions.h"
#include "mobility/CoincidenceCheck.h"

using namespace Eigen;
using namespace std;

namespace RigidHIPlugin {

namespace {

vector<int> firstRows(const RigidMotion& motion) {
    vector<int> rows;
    for (size_t e = 0; e < motion.getElements().size(); e++) rows.push_back(motion.firstRow(e));
    return rows;
}

vector<FluidElement> withSpins(vector<FluidElement> elements, const vector<SlowedSpin>& spins) {
    for (size_t e = 0; e < elements.size(); e++) elements[e].spin = spins[e];
    return elements;
}

}  // namespace

CoupledBodies::CoupledBodies(const vector<FluidElement>& elements, const ModelFactory& makeModel,
                             bool mayBeConstant)
    : motion(elements), freeMotion(elements, firstRows(motion)), nullTwists(firstRows(motion)),
      nullTwistsOfFree(firstRows(motion)), ownTensors(firstRows(motion)) {
    if (getParticles().size() > 0) model = makeModel(getParticles());
    if (ForcesOnFluid::areIn(elements))
        forcesOnFluid = make_unique<ForcesOnFluid>(motion, makeModel);
    findProperties(mayBeConstant);
}

CoupledBodies::CoupledBodies(const CoupledBodies& bodies, const vector<SlowedSpin>& spins)
    : motion(withSpins(bodies.getElements(), spins)),
      freeMotion(bodies.getElements(), firstRows(motion)), nullTwists(firstRows(motion)),
      nullTwistsOfFree(firstRows(motion)), ownTensors(firstRows(motion)), model(bodies.model),
      forcesOnFluid(bodies.forcesOnFluid), box(bodies.box) {
    findProperties(bodies.aloneInUniformFluid);
}

void CoupledBodies::findProperties(bool mayBeConstant) {
    const vector<FluidElement>& elements = getElements();
    aloneInUniformFluid =
        mayBeConstant && elements.size() == 1 &&
        (!model || (model->getTraits().isHomogeneous && model->getTraits().isIsotropic));
    const bool constant = isConstantInBodyFrame();
    spinsOfSlips.assign(elements.size(), 0);
    for (size_t e = 0; e < elements.size(); e++) {
        const FluidElement& element = elements[e];
        const bool hasOwnTensor = element.ownMobility.size() > 0;
        active = active || !element.slips.empty();
        // A constant own tensor also resists rotation about the line of the blobs.
        if (element.particles.size() > 1 && !(constant && hasOwnTensor)) {
            checkSites(e);
            nullTwists.find(e, element.sites);
            nullTwistsOfFree.find(e, element.sites);
            nullTwistsOfFree.fix(e, element);
        }
        if (hasOwnTensor && hasNullVector(e))
            throw OpenMM::OpenMMException(
                "MobilityForce: body " + to_string(element.body) +
                " was given a tensor of its own, but its hydrodynamic particles lie on a line; the "
                "model has no rotational mobility about this line that the tensor could be "
                "combined with: give only one of the particles a radius, or use FreeDraining");
    }
    for (size_t e = 0; e < elements.size(); e++) {
        if (!elements[e].slips.empty() && elements[e].slowsK()) findSpinOfSlips(e);
        if (hasNullVector(e)) checkForcesOnFluid(e);
    }
    if (constant) return;
    for (size_t e = 0; e < elements.size(); e++)
        if (elements[e].ownMobility.size() > 0)
            ownTensors.set(e, elements[e].ownMobility, aloneInModel(e).mobility, elements[e].spin);
}

CoupledBodies::Alone CoupledBodies::alone(int e) const {
    const MatrixXd& own = getElements()[e].ownMobility;
    if (own.size() > 0) return {own, inverseOf(own)};
    return aloneInModel(e);
}

/** alone() without own tensors. */
CoupledBodies::Alone CoupledBodies::aloneInModel(int e) const {
    const FluidElement& element = getElements()[e];
    MatrixXd M;
    model->ownMobility(particlesOf({element}), sitesOf(element), M);
    if (RigidMotion({element}).isIdentity()) return {M, inverseOf(M)};
    MatrixXd K = motion.ofElement_body(e);
    CholeskyFactor factor;
    if (!factor.compute(M)) refuseIndefiniteMobility(element.particles.size());
    factor.solveL(K);
    MatrixXd xi(6, 6);
    xi.noalias() = K.transpose() * K;
    xi = 0.5 * (xi + xi.transpose()).eval();
    if (hasNullVector(e)) return {generalisedInverse(xi, getNullVector_body(e)), xi};
    // N = R^-1 R^-T keeps the digits of a nearly straight body; the rounding of xi would lose its
    // friction about its line.
    const MatrixXd R = triangleOfQR(K);
    const MatrixXd inverseOfR = R.triangularView<Upper>().solve(MatrixXd::Identity(6, 6));
    return {inverseOfR * inverseOfR.transpose(), xi};
}

void CoupledBodies::findSpinOfSlips(int e) {
    const FluidElement& element = getElements()[e];
    MatrixXd M, slips(element.numParticleRows(), 1);
    model->ownMobility(particlesOf({element}), sitesOf(element), M);
    for (size_t i = 0; i < element.slips.size(); i++)
        slips.block<3, 1>(3 * i, 0) = -element.slips[i];
    CholeskyFactor factor;
    if (!factor.compute(M)) refuseIndefiniteMobility(element.particles.size());
    FluidElement atFullSpin = element;
    atFullSpin.spin = SlowedSpin();
    MatrixXd K = RigidMotion({atFullSpin}).ofElement_body(0);
    factor.solveL(K);
    factor.solveL(slips);
    const VectorXd twist = shortestLeastSquares(K, slips);
    spinsOfSlips[e] = element.spin.axis.dot(twist.tail<3>());
}

/** Refuse a torque about the line of a body's blobs, since nothing resists this torque. */
void CoupledBodies::checkForcesOnFluid(int e) const {
    const FluidElement& element = getElements()[e];
    const Matrix<double, 6, 1> wrench = ForcesOnFluid::wrench_body(element);
    const double torque = getNullVector_body(e).dot(wrench), torqueTolerance = 1e-9;
    double scale = 0;
    for (const ForceOnFluid& force : element.forcesOnFluid)
        scale += force.force.norm() * (force.site.norm() + length(e));
    if (abs(torque) <= torqueTolerance * scale) return;
    ostringstream text;
    text << "MobilityForce: body " << element.body << " takes a torque of " << torque
         << " kJ/mol about the line of its hydrodynamic particles from its forces on the fluid "
            "(addBodyForceOnFluid()), which nothing resists; this torque must be 0 within 1e-9 of "
            "force times size: move the sites of these forces to the line, or give the body "
            "hydrodynamic particles off the line";
    throw OpenMM::OpenMMException(text.str());
}

/** Check the sites of a body's blobs once, since they are constant. */
void CoupledBodies::checkSites(int e) const {
    const FluidElement& element = getElements()[e];
    CoincidenceCheck().check(particlesOf({element}), sitesOf(element), 1);
    // Blobs of different radii at one place have a mobility, but forces on them cannot turn the
    // body.
    double largestRadius = 0, size = 0;
    for (size_t i = 0; i < element.sites.size(); i++) {
        largestRadius = max(largestRadius, element.radii[i]);
        size = max(size, (element.sites[i] - element.sites[0]).norm());
    }
    if (size > CoincidenceCheck::bound * largestRadius) return;
    ostringstream text;
    text << "MobilityForce: body " << element.body << ": its " << element.sites.size()
         << " hydrodynamic particles are all at one place, within " << size
         << " nm; blobs that are nearer to each other than 1e-6 of their radius, here "
         << CoincidenceCheck::bound * largestRadius
         << " nm, do not resist rotation: give all but one of them the radius 0, which makes the "
            "body a sphere, or move their sites apart";
    throw OpenMM::OpenMMException(text.str());
}

double CoupledBodies::length(int e) const {
    const FluidElement& element = getElements()[e];
    double longest = 0;
    for (size_t i = 0; i < element.sites.size(); i++)
        for (size_t k = 0; k <= i; k++)
            longest = max(longest, (element.sites[i] - element.sites[k]).norm() + element.radii[i] +
                                       element.radii[k]);
    return longest > 0 ? longest : 1;
}

}  // namespace RigidHIPlugin

#include "DeviceBodies.h"

#include <openmm/common/ContextSelector.h>
#include <openmm/common/IntegrationUtilities.h>

#include <algorithm>
#include <map>

#include "context/KernelArrays.h"
#include "schemes/MomentumFlow.h"
#include "schemes/Thermostats-inl.h"

using namespace OpenMM;
using namespace std;

namespace RigidHIPlugin {

namespace {

const int lanes = BodySet::blockSize;
const int numColumns = 19, numFactors = 20, numMeans = 8;

/** The columns of the state in the order of kernels/bodies.cc. */
template <class Set, class Column>
void columnsOf(Set& bodies, vector<Column*>& columns) {
    for (int k = 0; k < 3; k++) columns.push_back(&bodies.R[k]);
    for (int k = 0; k < 4; k++) columns.push_back(&bodies.q[k]);
    for (int k = 0; k < 3; k++) columns.push_back(&bodies.p[k]);
    for (int k = 0; k < 3; k++) columns.push_back(&bodies.l[k]);
    for (int k = 0; k < 3; k++) columns.push_back(&bodies.force_lab[k]);
    for (int k = 0; k < 3; k++) columns.push_back(&bodies.torque[k]);
}

DeviceKind kindOf(RotorKind rotor) {
    switch (rotor) {
        case RotorKind::General: return DeviceKind::General;
        case RotorKind::Linear: return DeviceKind::Linear;
        case RotorKind::Point: return DeviceKind::Point;
        case RotorKind::Held: break;
    }
    return DeviceKind::Held;
}

/**
 * Free particles have slots after those of bodies, in whole blocks; particles that move come first.
 */
vector<int> slotsOfFree(const Scene& scene, int firstSlot) {
    const FreeParticles& free = *scene.freeParticles;
    vector<int> slots(free.getNumParticles());
    int slot = firstSlot;
    for (int i = 0; i < free.getNumParticles(); i++)
        if (!free.isHeld(i)) slots[i] = slot++;
    slot = (slot + lanes - 1) / lanes * lanes;
    for (int i = 0; i < free.getNumParticles(); i++)
        if (free.isHeld(i)) slots[i] = slot++;
    return slots;
}

}  // namespace

/** A kernel whose arguments have names. */
class DeviceBodies::Kernel {
public:
    Kernel(ComputeContext& cc, ComputeProgram& program, const string& name, long long& launches)
        : kernel(program->createKernel(name)), launches(launches) {}
    Kernel& add(ArrayInterface& array) {
        kernel->addArg(array);
        count++;
        return *this;
    }
    template <class T>
    Kernel& add(const string& name, const T& value) {
        places[name] = count++;
        kernel->addArg(value);
        return *this;
    }
    bool has(const string& name) const { return places.count(name) != 0; }
    template <class T>
    void set(const string& name, const T& value) {
        kernel->setArg(places.at(name), value);
    }
    void run(int threads, int blockSize = -1) {
        kernel->execute(threads, blockSize);
        launches++;
    }

private:
    ComputeKernel kernel;
    map<string, int> places;
    int count = 0;
    long long& launches;
};

/**
 * Records that OpenMM has sorted the particles, and moved molecules into the box: their places and
 * their images are then new.
 */
class DeviceBodies::SortListener : public ComputeContext::ReorderListener {
public:
    void execute() override { placesAreNew = imagesAreNew = true; }
    bool placesAreNew = true, imagesAreNew = true;
};

DeviceBodies::DeviceBodies(unique_ptr<const Device> device)
    : device(move(device)), cc(this->device->getContext()), listener(new SortListener) {
    cc.addReorderListener(listener);
}

DeviceBodies::~DeviceBodies() = default;

bool DeviceBodies::hasBodies(const Scene& scene) {
    return scene.bodies.getNumBodies() + scene.freeParticles->getNumParticles() > 0;
}

void DeviceBodies::makeShapes(const Scene& scene) {
    const BodySet& bodies = scene.bodies;
    const FreeParticles& free = *scene.freeParticles;
    bodySlots = bodies.bodyOfSlot.size();
    const vector<int> freeSlots = slotsOfFree(scene, bodySlots);
    slots = bodySlots;
    for (int slot : freeSlots) slots = max(slots, slot + 1);
    slots = (slots + lanes - 1) / lanes * lanes;

    vector<mm_int4> blockRows;
    for (const auto& block : bodies.blocks)
        blockRows.emplace_back((int)kindOf(block.rotor), block.firstSite, block.numSites, 0);
    vector<int> index(slots, -1), forceParticles = bodies.forceParticle;
    copy(bodies.bodyOfSlot.begin(), bodies.bodyOfSlot.end(), index.begin());
    siteParticles = bodies.siteParticle;
    vector<double> places = bodies.sites;
    for (int slot = bodySlots; slot < slots; slot += lanes) {
        blockRows.emplace_back((int)DeviceKind::Free, (int)siteParticles.size() / lanes, 1, 0);
        for (vector<int>* list : {&siteParticles, &forceParticles})
            list->resize(list->size() + lanes, -1);
        places.resize(places.size() + 3 * lanes, 0.0);
    }
    for (int i = 0; i < free.getNumParticles(); i++) {
        const int slot = freeSlots[i], particle = free.getParticles()[i];
        mm_int4& block = blockRows[slot / lanes];
        if (free.isHeld(i)) block.x = (int)DeviceKind::Held;
        index[slot] = particle;
        siteParticles[block.y * lanes + slot % lanes] = particle;
        forceParticles[block.y * lanes + slot % lanes] = particle;
    }
    device->give(blocks, blockRows, "blocks");
    device->give(noiseIndex, index, "noiseIndex");
    device->give(siteParticle, siteParticles, "siteParticle");
    device->give(forceParticle, forceParticles, "forceParticle");
    device->give(sites, places, "sites");
    device->give(images, vector<int>(3 * siteParticles.size(), 0), "images");
    device->give(placeOf, vector<int>(cc.getNumAtoms(), 0), "placeOf");
    device->reserve<int>(sitePlace, siteParticles.size(), "sitePlace");
    device->reserve<int>(forcePlace, siteParticles.size(), "forcePlace");
    device->give(flags, vector<int>(2, 0), "flags");
    device->give(sums, vector<double>(5, 0.0), "sums");
    device->give(momentumPart, vector<double>(3 * momentumParts, 0.0), "momentumParts");
    device->give(momentum, vector<double>(3, 0.0), "momentum");
    freeVirtualSites.clear();
    for (int p : scene.stock.virtualSites)
        if (scene.stock.bodyOfParticle[p] < 0)
            freeVirtualSites.emplace_back(p, scene.system.getVirtualSite(p).getParticle(0));
    totalMass = 0;
    for (int b = 0; b < bodies.getNumBodies(); b++) totalMass += bodies.inertia(b).mass;
    for (int i = 0; i < free.getNumParticles(); i++) totalMass += free.mass(i);
}

void DeviceBodies::makeFactors(const Scene& scene) {
    const BodySet& b = scene.bodies;
    const FreeParticles& free = *scene.freeParticles;
    const BodySet::Column* const columns[numFactors] = {&b.inverseMass,
                                                        &b.inverseMoments[0],
                                                        &b.inverseMoments[1],
                                                        &b.inverseMoments[2],
                                                        &b.decay_p,
                                                        &b.noise_p,
                                                        &b.move_R,
                                                        &b.noise_R,
                                                        &b.decay_l[0],
                                                        &b.decay_l[1],
                                                        &b.decay_l[2],
                                                        &b.noise_l[0],
                                                        &b.noise_l[1],
                                                        &b.noise_l[2],
                                                        &b.move_q[0],
                                                        &b.move_q[1],
                                                        &b.move_q[2],
                                                        &b.noise_q[0],
                                                        &b.noise_q[1],
                                                        &b.noise_q[2]};
    vector<double> values((size_t)numFactors * slots, 0.0);
    for (int c = 0; c < numFactors; c++)
        for (int slot = 0; slot < bodySlots; slot++)
            values[(size_t)c * slots + slot] = (*columns[c])[slot];
    const vector<int> freeSlots = slotsOfFree(scene, bodySlots);
    hasNoise = false;
    long long numbers = 0;
    for (int slot = 0; slot < bodySlots; slot++)
        if (b.drawsNoise[slot]) {
            hasNoise = true;
            const RotorKind rotor = b.blocks[slot / lanes].rotor;
            numbers += rotor == RotorKind::Point ? 3 : rotor == RotorKind::Linear ? 5 : 6;
        }
    for (int i = 0; i < free.getNumParticles(); i++) {
        const Thermostat& t = free.getThermostat(i);
        const double ofParticle[] = {free.mass(i) > 0 && !free.isHeld(i) ? 1 / free.mass(i) : 0,
                                     0,
                                     0,
                                     0,
                                     t.decay_p,
                                     t.noise_p,
                                     t.move_R,
                                     t.noise_R};
        for (int c = 0; c < 8; c++) values[(size_t)c * slots + freeSlots[i]] = ofParticle[c];
        if (t.hasNoise() && !free.isHeld(i)) {
            hasNoise = true;
            numbers += 3;
        }
    }
    device->give(factors, values, "factors");
    const SchemeProgram before = beforeForcesOf(scene.settings.scheme, DeviceKind::General, true),
                        after = afterForcesOf(scene.settings.scheme, DeviceKind::General, true);
    randomNumbers = numbers * (before.draws[0] + before.draws[1] + after.draws[0] + after.draws[1]);

    // Mid-step momenta, for the sum of energies.
    vector<double> ofMeans((size_t)numMeans * slots, 0.0);
    scalar::withThermostat(scene.settings.scheme, [&](auto scheme) {
        for (int slot = 0; slot < bodySlots; slot++)
            for (int k = 0; k < 4; k++) {
                const double decay = k == 0 ? b.decay_p[slot] : b.decay_l[k - 1][slot];
                const auto flow =
                    MomentumFlow::upToDrift<decltype(scheme)>(decay, 0, scene.settings.h);
                ofMeans[(size_t)2 * k * slots + slot] = flow.factor;
                ofMeans[(size_t)(2 * k + 1) * slots + slot] = flow.time;
            }
    });
    device->give(means, ofMeans, "means");
}

void DeviceBodies::compile(const Scene& scene) {
    BodiesOnDevice shape;
    shape.scheme = scene.settings.scheme;
    shape.slots = slots;
    shape.bodySlots = bodySlots;
    shape.particles = cc.getNumAtoms();
    shape.paddedParticles = cc.getPaddedNumAtoms();
    shape.isPeriodic = isPeriodic;
    shape.isConstrained = isConstrained;
    shape.hasMomenta = hasMomenta = scene.settings.hasMomenta();
    const KernelProgram wanted = programOf(shape);
    if (wanted.whole() == compiled) return;  // other temperatures need no other kernels
    ComputeProgram program = device->compile(wanted);
    compiled = wanted.whole();

    // A platform without mixed precision has no array of corrections of positions.
    ArrayInterface& correction = cc.getUseMixedPrecision() ? cc.getPosqCorrection() : cc.getPosq();
    const auto make = [&](const string& name) {
        return make_unique<Kernel>(cc, program, name, counts.launches);
    };
    const auto addBox = [](Kernel& kernel) {
        for (const char* name : {"a_x", "b_x", "b_y", "c_x", "c_y", "c_z"}) kernel.add(name, 0.0);
    };
    const auto addStep = [](Kernel& kernel) {
        kernel.add("h", 0.0).add("seed", 0u).add("stepLow", 0u).add("stepHigh", 0u);
        kernel.add("law", 0).add("hasNoise", 0);
    };
    findPlacesKernel = make("findPlaces");
    findPlacesKernel->add(cc.getAtomIndexArray()).add(placeOf);
    findPlacesOfSitesKernel = make("findPlacesOfSites");
    for (ArrayInterface* array : initializer_list<ArrayInterface*>{
             &placeOf, &siteParticle, &forceParticle, &sitePlace, &forcePlace})
        findPlacesOfSitesKernel->add(*array);
    findPlacesOfSitesKernel->add("numEntries", 0);
    takeInKernel = make("takeInPositions");
    for (ArrayInterface* array : initializer_list<ArrayInterface*>{
             &state, &blocks, &noiseIndex, &sites, &sitePlace, &forcePlace, &images, &cc.getPosq(),
             &correction, &flags})
        takeInKernel->add(*array);
    takeInKernel->add("moves", 0).add("rounding", 0.0).add("beside", 0.0);
    addBox(*takeInKernel);
    writeKernel = make("writePositions");
    for (ArrayInterface* array :
         initializer_list<ArrayInterface*>{&state, &blocks, &noiseIndex, &sites, &sitePlace,
                                           &images, &cc.getPosq(), &correction, &flags})
        writeKernel->add(*array);
    addBox(*writeKernel);
    beforeKernel = make("beforeForces");
    for (ArrayInterface* array : initializer_list<ArrayInterface*>{
             &state, &factors, &blocks, &noiseIndex, &sites, &sitePlace, &images, &cc.getPosq(),
             &correction, &momentum, &flags})
        beforeKernel->add(*array);
    addStep(*beforeKernel);
    beforeKernel->add("removesMomentum", 0).add("totalMass", 1.0);
    addBox(*beforeKernel);
    afterKernel = make("afterForces");
    for (ArrayInterface* array : initializer_list<ArrayInterface*>{
             &state, &factors, &blocks, &noiseIndex, &sites, &sitePlace, &forcePlace, &cc.getVelm(),
             &cc.getLongForceBuffer(), &flags})
        afterKernel->add(*array);
    addStep(*afterKernel);
    afterKernel->add("onlyGathers", 0);
    if (isConstrained) {
        ArrayInterface& posDelta = cc.getIntegrationUtilities().getPosDelta();
        moveFreeKernel = make("moveFree");
        for (ArrayInterface* array :
             initializer_list<ArrayInterface*>{&state, &factors, &blocks, &noiseIndex, &sitePlace,
                                               &cc.getVelm(), &posDelta, &flags})
            moveFreeKernel->add(*array);
        moveFreeKernel->add("move", 0).add("t", 0.0).add("purpose", 0u).add("seed", 0u);
        moveFreeKernel->add("stepLow", 0u).add("stepHigh", 0u).add("law", 0);
        endDriftKernel = make("endDriftOfFree");
        for (ArrayInterface* array : initializer_list<ArrayInterface*>{
                 &state, &blocks, &noiseIndex, &sitePlace, &images, &cc.getPosq(), &correction,
                 &cc.getVelm(), &posDelta, &flags})
            endDriftKernel->add(*array);
        endDriftKernel->add("t", 0.0);
        addBox(*endDriftKernel);
        writeVelocitiesKernel = make("writeVelocitiesOfBodies");
        for (ArrayInterface* array : initializer_list<ArrayInterface*>{
                 &state, &factors, &blocks, &noiseIndex, &sites, &sitePlace, &cc.getVelm(), &flags})
            writeVelocitiesKernel->add(*array);
    }
    takeInFreeKernel = make("takeInVelocitiesOfFree");
    for (ArrayInterface* array : initializer_list<ArrayInterface*>{
             &state, &blocks, &noiseIndex, &sitePlace, &cc.getVelm(), &flags})
        takeInFreeKernel->add(*array);
    sumMomentaKernel = make("sumMomenta");
    for (ArrayInterface* array :
         initializer_list<ArrayInterface*>{&state, &factors, &blocks, &noiseIndex, &momentumPart})
        sumMomentaKernel->add(*array);
    addMomentaKernel = make("addMomenta");
    addMomentaKernel->add(momentumPart).add(momentum);
    energiesKernel = make("addEnergies");
    for (ArrayInterface* array :
         initializer_list<ArrayInterface*>{&state, &factors, &means, &blocks, &noiseIndex, &sums})
        energiesKernel->add(*array);
}

void DeviceBodies::upload(const Scene& scene) {
    ContextSelector selector(cc);
    if (shapesVersion != scene.settings.getVersion()) {
        isPeriodic = scene.system.usesPeriodicBoundaryConditions();
        rounding = scene.arrays->rounding().positions;
        isConstrained = scene.freeParticles->getNumConstraints() > 0;
        makeShapes(scene);
        makeFactors(scene);
        device->reserve<double>(state, (size_t)numColumns * slots, "state");
        device->reserve<double>(savedState, (size_t)numColumns * slots, "savedState");
        compile(scene);
        shapesVersion = scene.settings.getVersion();
    }
    const FreeParticles& free = *scene.freeParticles;
    vector<const BodySet::Column*> columns;
    columnsOf(scene.bodies, columns);
    vector<double> values((size_t)numColumns * slots, 0.0);
    for (int c = 0; c < numColumns; c++)
        for (int slot = 0; slot < bodySlots; slot++)
            values[(size_t)c * slots + slot] = (*columns[c])[slot];
    const vector<int> freeSlots = slotsOfFree(scene, bodySlots);
    FreeParticles::Snapshot particles;
    free.save(particles, scene.arrays->positions(), scene.arrays->velocities());
    for (int i = 0; i < free.getNumParticles(); i++) {
        const auto column = [&](int c) -> double& {
            return values[(size_t)c * slots + freeSlots[i]];
        };
        column(3) = 1;
        for (int k = 0; k < 3; k++) {
            column(k) = particles.positions[i][k];
            column(7 + k) = free.isHeld(i) ? 0 : particles.velocities[i][k];
            column(13 + k) = particles.forces[i][k];
        }
    }
    device->give(state, values, "state");
    counts.transfers++;
    restart();
    particlesWereSorted();
    writePositions();
}

void DeviceBodies::giveTo(Scene& scene, ComputeArray& from) {
    ContextSelector selector(cc);
    vector<double> values;
    from.download(values);
    counts.transfers++;
    vector<BodySet::Column*> columns;
    columnsOf(scene.bodies, columns);
    for (int c = 0; c < numColumns; c++)
        for (int slot = 0; slot < bodySlots; slot++)
            (*columns[c])[slot] = values[(size_t)c * slots + slot];
    FreeParticles& free = *scene.freeParticles;
    FreeParticles::Snapshot particles;
    free.save(particles, scene.arrays->positions(), scene.arrays->velocities());
    const vector<int> freeSlots = slotsOfFree(scene, bodySlots);
    for (int i = 0; i < free.getNumParticles(); i++)
        for (int k = 0; k < 3; k++) {
            const auto column = [&](int c) { return values[(size_t)c * slots + freeSlots[i]]; };
            if (!free.isHeld(i)) particles.positions[i][k] = column(k);
            if (scene.settings.hasMomenta()) particles.velocities[i][k] = column(7 + k);
            particles.forces[i][k] = column(13 + k);
        }
    free.restore(particles, scene.arrays->positions(), scene.arrays->velocities());
}

void DeviceBodies::save() {
    ContextSelector selector(cc);
    state.copyTo(savedState);
    nonFinite = false;
}

void DeviceBodies::setBox() {
    Vec3 box[3];
    cc.getPeriodicBoxVectors(box[0], box[1], box[2]);
    const double values[] = {box[0][0], box[1][0], box[1][1], box[2][0], box[2][1], box[2][2]};
    const char* const names[] = {"a_x", "b_x", "b_y", "c_x", "c_y", "c_z"};
    for (Kernel* kernel :
         {takeInKernel.get(), beforeKernel.get(), writeKernel.get(), endDriftKernel.get()})
        for (int k = 0; kernel && k < 6; k++) kernel->set(names[k], values[k]);
    longestEdge = 0;
    for (const Vec3& edge : box)
        if (isPeriodic) longestEdge = max(longestEdge, sqrt(edge.dot(edge)));
}

void DeviceBodies::findPlaces() {
    findPlacesKernel->run(cc.getNumAtoms());
    findPlacesOfSitesKernel->set("numEntries", static_cast<int>(siteParticles.size()));
    findPlacesOfSitesKernel->run(siteParticles.size());
    listener->placesAreNew = false;
}

void DeviceBodies::particlesWereSorted() {
    ContextSelector selector(cc);
    findPlaces();
    if (seesImages)
        leaveImages();
    else
        compareWithParticles();
}

bool DeviceBodies::agreeWithParticles() {
    ContextSelector selector(cc);
    if (listener->placesAreNew) findPlaces();
    const bool imagesAreNew = listener->imagesAreNew;
    compareWithParticles();
    if (!isStopped()) {
        if (seesImages && imagesAreNew) leaveImages();
        return true;
    }
    restart();
    return false;
}

void DeviceBodies::takeInVelocities() {
    if (!hasMomenta || slots == bodySlots) return;
    ContextSelector selector(cc);
    takeInFreeKernel->run(slots - bodySlots);
}

void DeviceBodies::compareWithParticles(bool moves) {
    listener->imagesAreNew = false;
    setBox();
    takeInKernel->set("moves", moves ? 1 : 0);
    // The pose has its own rounding in addition to that of the particle.
    takeInKernel->set("rounding", 2 * rounding + 1e-14);
    takeInKernel->set("beside", longestEdge);
    takeInKernel->run(slots);
}

/**
 * Tell OpenMM in which images it keeps particles. Virtual sites are in the images of their parents.
 */
void DeviceBodies::giveImages() {
    vector<int> values;
    images.download(values);
    counts.transfers++;
    const vector<int>& particleOfPlace = cc.getAtomIndex();
    vector<int> places(cc.getNumAtoms());
    for (int i = 0; i < cc.getNumAtoms(); i++) places[particleOfPlace[i]] = i;
    vector<mm_int4>& offsets = cc.getPosCellOffsets();
    for (size_t i = 0; i < siteParticles.size(); i++) {
        if (siteParticles[i] < 0) continue;
        const size_t entry = i / lanes, lane = i % lanes;
        const auto n = [&](int k) { return values[(entry * 3 + k) * lanes + lane]; };
        offsets[places[siteParticles[i]]] = mm_int4(n(0), n(1), n(2), 0);
    }
    for (const auto& site : freeVirtualSites)
        offsets[places[site.first]] = offsets[places[site.second]];
}

/**
 * Put particles where their bodies are, and not into images in the box, because some Force acts
 * differently on images.
 */
void DeviceBodies::leaveImages() {
    listener->imagesAreNew = false;
    setBox();
    cc.clearBuffer(images);
    for (mm_int4& offset : cc.getPosCellOffsets()) offset = mm_int4(0, 0, 0, 0);
    writeKernel->run(slots);
}

void DeviceBodies::particlesWereMoved(bool kept) {
    ContextSelector selector(cc);
    findPlaces();
    compareWithParticles(!kept);
    if (seesImages)
        leaveImages();
    else if (isPeriodic)
        giveImages();
}

void DeviceBodies::writePositions() {
    ContextSelector selector(cc);
    writeKernel->run(slots);
}

void DeviceBodies::setStep(Kernel& kernel, const StepSettings& settings) {
    const uint64_t step = static_cast<uint64_t>(settings.noise.step);
    if (kernel.has("h")) kernel.set("h", settings.h);
    kernel.set("seed", static_cast<unsigned int>(settings.noise.seed));
    kernel.set("stepLow", static_cast<unsigned int>(step));
    kernel.set("stepHigh", static_cast<unsigned int>(step >> 32));
    kernel.set("law", static_cast<int>(settings.noise.law));
    if (kernel.has("hasNoise")) kernel.set("hasNoise", hasNoise ? 1 : 0);
}

/**
 * The moves of free particles with constraints, a kernel for each. OpenMM's constraints hold
 * positions after every drift and velocities after every move, as in FreeParticles. They also act
 * on velocities of rigid bodies with constraints, which are then written again.
 */
class DeviceBodies::ConstrainedFlow {
public:
    ConstrainedFlow(DeviceBodies& owner, const StepSettings& settings)
        : owner(owner), settings(settings), utilities(owner.cc.getIntegrationUtilities()) {}
    void kick(double t) {
        move(Kick, t);
        constrainVelocities();
    }
    void drift(double t) {
        owner.cc.clearBuffer(utilities.getPosDelta());
        move(Drift, t);
        utilities.applyConstraints(owner.constraintTolerance);
        owner.endDriftKernel->set("t", t);
        owner.endDriftKernel->run(owner.slots - owner.bodySlots);
        constrainVelocities();
    }
    void damp() { move(Damp, 0); }
    void addNoise(int draw) {
        if (!owner.hasNoise) return;
        move(Noise, 0, draw == 0 ? NoiseStream::FreeFirstDraw : NoiseStream::FreeSecondDraw);
        constrainVelocities();
    }
    void ornsteinUhlenbeck(int draw) {
        damp();
        addNoise(draw);
    }
    /** The gradient scheme refuses constraints. */
    void gradientMove(int) {}

private:
    void move(FreeMove kind, double t, unsigned int purpose = 0) {
        Kernel& kernel = *owner.moveFreeKernel;
        owner.setStep(kernel, settings);
        kernel.set("move", static_cast<int>(kind));
        kernel.set("t", t);
        kernel.set("purpose", purpose);
        kernel.run(owner.slots - owner.bodySlots);
    }
    void constrainVelocities() {
        utilities.applyVelocityConstraints(owner.constraintTolerance);
        owner.takeInFreeKernel->run(owner.slots - owner.bodySlots);
    }
    DeviceBodies& owner;
    const StepSettings& settings;
    IntegrationUtilities& utilities;
};

void DeviceBodies::beforeForces(const StepSettings& settings, bool removesMomentum) {
    ContextSelector selector(cc);
    if (listener->imagesAreNew) particlesWereSorted();
    removesMomentum = removesMomentum && totalMass > 0;
    if (removesMomentum) {
        sumMomentaKernel->run(momentumParts);
        addMomentaKernel->run(sumThreads, sumThreads);
    }
    setStep(*beforeKernel, settings);
    beforeKernel->set("removesMomentum", removesMomentum ? 1 : 0);
    beforeKernel->set("totalMass", totalMass);
    beforeKernel->run(slots);
    if (!isConstrained) return;
    ConstrainedFlow flow(*this, settings);
    scalar::withThermostat(settings.scheme,
                           [&](auto scheme) { scheme.beforeForces(flow, settings.h); });
}

void DeviceBodies::afterForces(const StepSettings& settings, bool onlyGathers) {
    ContextSelector selector(cc);
    if (listener->placesAreNew) findPlaces();  // only gathering, before a step
    setStep(*afterKernel, settings);
    afterKernel->set("onlyGathers", onlyGathers ? 1 : 0);
    afterKernel->run(slots);
    if (!isConstrained || onlyGathers) return;
    ConstrainedFlow flow(*this, settings);
    scalar::withThermostat(settings.scheme,
                           [&](auto scheme) { scheme.afterForces(flow, settings.h); });
    if (bodySlots > 0) writeVelocitiesKernel->run(bodySlots);
}

bool DeviceBodies::isStopped() {
    ContextSelector selector(cc);
    vector<int> values;
    flags.download(values);
    counts.looks++;
    nonFinite = values[0] != 0;
    return values[0] != 0 || values[1] != 0;
}

void DeviceBodies::restart() {
    ContextSelector selector(cc);
    flags.upload(vector<int>(2, 0));
}

MidStepEnergies DeviceBodies::midStepEnergies() {
    ContextSelector selector(cc);
    energiesKernel->run(sumThreads, sumThreads);
    vector<double> values;
    sums.download(values);
    counts.looks++;
    MidStepEnergies result;
    result.translational = values[0] / 2;
    result.rotational = values[1] / 2;
    result.momentum = Vec3(values[2], values[3], values[4]);
    return result;
}

}  // namespace RigidHIPlugin

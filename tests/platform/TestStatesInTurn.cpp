// Trajectories that take turns in one Context, by States or checkpoints, have random numbers of
// their own. With the same numbers, Langevin trajectories come together: a wrong ensemble that no
// average over one trajectory shows.

#include <openmm/CustomExternalForce.h>

#include <sstream>

#include "TestSupport.h"
#include "openmmrigidhi/MobilityForce.h"
#include "openmmrigidhi/SchemeTraits.h"

using namespace OpenMM;
using namespace RigidHITest;
using namespace std;

namespace {

const int numBodies = 100;
const double temperature = 300;

/** Bodies that feel nothing but friction and noise; after 100 steps they have forgotten all. */
struct Turns {
    System system;
    CustomRigidHIIntegrator integrator{temperature, 0.02};
    unique_ptr<Context> context;

    explicit Turns(int seed = 5,
                   CustomRigidHIIntegrator::Scheme scheme = CustomRigidHIIntegrator::LangevinC) {
        auto* field = new CustomExternalForce("pull*x");
        field->addGlobalParameter("pull", 0);
        for (int b = 0; b < numBodies; b++) {
            field->addParticle(system.addParticle(5.0));
            integrator.addRigidBody({b}, 5.0, Vec3(0.2, 0.1, 0.15), {Vec3()});
        }
        system.addForce(field);
        if (scheme == CustomRigidHIIntegrator::FixmanMidpoint) {
            auto* fluid = new RigidHIPlugin::MobilityForce();
            for (int b = 0; b < numBodies; b++) fluid->addParticle(0.1);
            fluid->setViscosity(500);
            system.addForce(fluid);
        }
        integrator.setScheme(scheme);
        integrator.setFriction(5);
        integrator.setRotationalFriction(5);
        integrator.setRandomNumberSeed(seed);
        context = make_unique<Context>(system, integrator, testPlatform());
        vector<Vec3> positions;
        for (int b = 0; b < numBodies; b++) positions.push_back(Vec3(b % 5, b / 5 % 5, b / 25) * 2);
        context->setPositions(positions);
        if (RigidHIPlugin::traitsOf(scheme).hasMomenta) draw(1);
    }
    void draw(int seed) { context->setVelocitiesToTemperature(temperature, seed); }
    State save() {
        return context->getState(State::Positions | State::Velocities | State::Parameters |
                                 State::IntegratorParameters);
    }
    vector<Vec3> velocities() { return integrator.getBodyVelocities(); }
    /** Load a state, take steps and save again. */
    State turn(const State& from, int steps = 100) {
        context->setState(from);
        integrator.step(steps);
        return save();
    }
};

double correlation(const vector<Vec3>& a, const vector<Vec3>& b) {
    double ab = 0, aa = 0, bb = 0;
    for (size_t i = 0; i < a.size(); i++) {
        ab += a[i].dot(b[i]);
        aa += a[i].dot(a[i]);
        bb += b[i].dot(b[i]);
    }
    return ab / sqrt(aa * bb);
}

/** Five standard errors of the correlation of as many independent numbers. */
const double noCorrelation = 5 / sqrt(3.0 * numBodies);

/** @param ends  velocities at the ends of runs, each of which is compared with all others */
void expectIndependent(const vector<vector<Vec3>>& ends) {
    for (size_t i = 0; i < ends.size(); i++)
        for (size_t j = 0; j < i; j++)
            EXPECT_LT(abs(correlation(ends[i], ends[j])), noCorrelation) << i << " and " << j;
}

}  // namespace

TEST(StatesInTurn, TrajectoriesHaveNoiseOfTheirOwn) {
    Turns turns;
    vector<State> replicas;
    for (int k : {0, 1, 2}) {
        turns.draw(10 + k);
        replicas.push_back(turns.save());
    }
    for (int round = 0; round < 3; round++)
        for (State& replica : replicas) replica = turns.turn(replica);
    for (int k : {0, 1, 2}) {
        EXPECT_LT(
            abs(correlation(replicas[k].getVelocities(), replicas[(k + 1) % 3].getVelocities())),
            noCorrelation)
            << k;
    }
}

TEST(StatesInTurn, OneStateWithVelocitiesDrawnAnewGivesIndependentTrajectories) {
    Turns turns;
    turns.integrator.step(10);
    const State start = turns.save();
    vector<vector<Vec3>> ends;
    for (int k : {0, 1, 2}) {
        turns.context->setState(start);
        turns.draw(20 + k);
        turns.integrator.step(100);
        ends.push_back(turns.velocities());
    }
    expectIndependent(ends);
}

/** As processes on a cluster do that begin with one equilibrated State. */
TEST(StatesInTurn, SoItIsInContextsThatKnowNothingOfEachOther) {
    Turns first;
    first.integrator.step(10);
    const State start = first.save();
    stringstream checkpoint;
    first.context->createCheckpoint(checkpoint);
    for (bool fromCheckpoint : {false, true}) {
        vector<vector<Vec3>> ends;
        for (int k : {0, 1, 0, 2}) {
            Turns own(50 + k);
            if (fromCheckpoint) {
                stringstream copy(checkpoint.str());
                own.context->loadCheckpoint(copy);
            } else
                own.context->setState(start);
            if (k < 2)
                own.draw(20 + k);
            else {
                vector<Vec3> reversed = velocitiesOf(*own.context);
                for (Vec3& v : reversed) v *= -1;
                own.context->setVelocities(reversed);
            }
            own.integrator.step(100);
            ends.push_back(own.velocities());
        }
        EXPECT_LT(abs(correlation(ends[0], ends[1])), noCorrelation) << fromCheckpoint;
        EXPECT_LT(abs(correlation(ends[0], ends[3])), noCorrelation) << fromCheckpoint;
        EXPECT_LT(abs(correlation(ends[1], ends[3])), noCorrelation) << fromCheckpoint;
        EXPECT_TRUE(sameBits(ends[0], ends[2])) << "the same changes give the same run";
    }
}

TEST(StatesInTurn, OneStateAtOtherTemperaturesOrParametersGivesIndependentTrajectories) {
    Turns turns;
    const State start = turns.save();
    vector<vector<Vec3>> ends;
    for (int k : {0, 1, 2}) {
        turns.context->setState(start);
        if (k == 1) turns.integrator.setTemperature(400);
        if (k == 2) turns.integrator.setTemperature(temperature);
        if (k == 2) turns.context->setParameter("pull", 1e-3);
        turns.integrator.step(100);
        ends.push_back(turns.velocities());
    }
    expectIndependent(ends);
}

TEST(StatesInTurn, WithoutMomentaToo) {
    Turns turns(5, CustomRigidHIIntegrator::FixmanMidpoint);
    const vector<Vec3> at = turns.integrator.getBodyPositions();
    vector<State> replicas;
    for (int k : {0, 1}) {
        vector<Vec3> moved = at;
        for (Vec3& x : moved) x[2] += 0.1 * k;
        turns.context->setPositions(moved);
        replicas.push_back(turns.save());
    }
    for (int round : {0, 1}) {
        vector<vector<Vec3>> displacements;
        for (State& replica : replicas) {
            const vector<Vec3> before = replica.getPositions();
            replica = turns.turn(replica, 3);
            displacements.push_back(replica.getPositions());
            for (int b = 0; b < numBodies; b++) displacements.back()[b] -= before[b];
        }
        EXPECT_LT(abs(correlation(displacements[0], displacements[1])), noCorrelation) << round;
    }
}

TEST(StatesInTurn, CheckpointsToo) {
    Turns turns;
    vector<string> replicas;
    vector<vector<Vec3>> ends(2);
    const auto checkpoint = [&] {
        stringstream stream;
        turns.context->createCheckpoint(stream);
        return stream.str();
    };
    for (int k : {0, 1}) {
        turns.draw(30 + k);
        replicas.push_back(checkpoint());
    }
    for (int round = 0; round < 2; round++)
        for (int k : {0, 1}) {
            stringstream stream(replicas[k]);
            turns.context->loadCheckpoint(stream);
            turns.integrator.step(100);
            ends[k] = turns.velocities();
            replicas[k] = checkpoint();
        }
    EXPECT_LT(abs(correlation(ends[0], ends[1])), noCorrelation);
}

/** The methods of the integrator that set bodies change a loaded state too. */
TEST(StatesInTurn, SettersOfBodiesChangeALoadedState) {
    Turns turns;
    turns.integrator.step(10);
    const State start = turns.save();
    for (int setter = 0; setter < 4; setter++) {
        vector<vector<Vec3>> ends;
        for (double factor : {1.0, 1.5, 2.0}) {
            turns.context->setState(start);
            auto scaled = [&](vector<Vec3> values) {
                for (Vec3& v : values) v *= factor;
                return values;
            };
            CustomRigidHIIntegrator& bodies = turns.integrator;
            if (setter == 0) bodies.setBodyVelocities(scaled(bodies.getBodyVelocities()));
            if (setter == 1)
                bodies.setBodyAngularVelocities(scaled(bodies.getBodyAngularVelocities()));
            if (setter == 2) bodies.setBodyPositions(scaled(bodies.getBodyPositions()));
            if (setter == 3) {
                vector<QuaternionArray> q(numBodies, {{cos(factor), sin(factor), 0, 0}});
                bodies.setBodyOrientations(q);
            }
            turns.integrator.step(100);
            ends.push_back(turns.velocities());
        }
        for (int k : {1, 2})
            EXPECT_LT(abs(correlation(ends[0], ends[k])), noCorrelation)
                << "setter " << setter << ", run " << k;
    }
}

/** What a changed state has when it is saved before its first step. */
TEST(StatesInTurn, AChangedStateIsSavedWithItsOwnSeed) {
    Turns turns;
    turns.integrator.step(10);
    const State start = turns.save();
    vector<vector<Vec3>> ends, atOnce;
    for (int k : {0, 1}) {
        turns.context->setState(start);
        turns.draw(60 + k);
        const State changed = turns.save();
        turns.integrator.step(100);
        atOnce.push_back(turns.velocities());
        Turns fresh(70);
        ends.push_back(fresh.turn(changed).getVelocities());
    }
    EXPECT_LT(abs(correlation(ends[0], ends[1])), noCorrelation);
    if (!onDevice()) {
        EXPECT_TRUE(sameBits(ends[0], atOnce[0]));
    }
}

/** Velocities that are drawn after a first step from one State. */
TEST(StatesInTurn, StatesThatAreSetLaterToo) {
    Turns turns;
    const State start = turns.save();
    vector<vector<Vec3>> ends;
    for (int k : {0, 1, 2}) {
        turns.context->setState(start);
        turns.integrator.step(1);
        turns.draw(80 + k);
        turns.integrator.step(100);
        ends.push_back(turns.velocities());
    }
    expectIndependent(ends);
}

/** Also where a trajectory has a seed of its own. */
TEST(StatesInTurn, AReplicaRepeatsItsTrajectoryToo) {
    Turns turns;
    vector<State> replicas;
    for (int k : {0, 1}) {
        turns.draw(10 + k);
        replicas.push_back(turns.save());
    }
    turns.turn(replicas[0], 20);
    turns.context->setState(replicas[1]);
    turns.integrator.step(4);
    const State middle = turns.save();
    turns.integrator.step(5);
    const vector<Vec3> end = turns.velocities();
    turns.context->setState(replicas[1]);
    turns.integrator.step(9);
    EXPECT_TRUE(sameBits(turns.velocities(), end)) << "from the start";
    turns.context->setState(middle);
    turns.integrator.step(5);
    EXPECT_TRUE(sameBits(turns.velocities(), end)) << "from the middle";
}

/** Nothing else has used the numbers, so loading a state repeats its trajectory bit for bit. */
TEST(StatesInTurn, AStateLoadedOnceMoreRepeatsItsTrajectory) {
    Turns turns;
    turns.integrator.step(3);
    const State start = turns.save();
    const auto ahead = [&] {
        turns.integrator.step(4);
        const State middle = turns.save();
        turns.integrator.step(5);
        return pair<State, vector<Vec3>>(middle, turns.velocities());
    };
    const auto first = ahead();
    for (int k = 0; k < 3; k++) {
        turns.context->setState(start);
        if (k == 1) {
            stringstream checkpoint;
            turns.context->createCheckpoint(checkpoint);
            turns.integrator.step(2);
            turns.context->loadCheckpoint(checkpoint);
        }
        EXPECT_TRUE(sameBits(ahead().second, first.second)) << "from the start";
        turns.context->setState(first.first);
        turns.integrator.step(5);
        EXPECT_TRUE(sameBits(turns.velocities(), first.second)) << "from the middle";
    }
}

/** Also where the Context has taken turns: with the same turns, or from a State of a turn. */
TEST(StatesInTurn, TurnsAreReproducible) {
    const auto run = [](Turns& turns) {
        vector<State> replicas;
        for (int k : {0, 1}) {
            turns.draw(10 + k);
            replicas.push_back(turns.save());
        }
        for (int round = 0; round < 2; round++)
            for (State& replica : replicas) replica = turns.turn(replica, 7);
        return replicas;
    };
    Turns turns, others, fresh(77);
    const vector<State> replicas = run(turns), same = run(others);
    for (int k : {0, 1}) {
        EXPECT_TRUE(sameBits(replicas[k].getVelocities(), same[k].getVelocities())) << k;
        // Each State has the seed of its trajectory.
        const State here = turns.turn(replicas[k], 6), there = fresh.turn(replicas[k], 6);
        EXPECT_TRUE(sameBits(here.getVelocities(), there.getVelocities())) << k;
    }
}

TEST(StatesInTurn, ASeedThatIsSetAfterLoadingStays) {
    Turns turns;
    const State start = turns.save();
    vector<vector<Vec3>> ends;
    for (int draw : {40, 41}) {
        turns.context->setState(start);
        turns.draw(draw);
        turns.integrator.setRandomNumberSeed(9);
        turns.integrator.step(100);
        EXPECT_EQ(turns.integrator.getRandomNumberSeed(), 9);
        ends.push_back(turns.velocities());
    }
    EXPECT_GT(correlation(ends[0], ends[1]), 0.99) << "the user has asked for the same numbers";
}

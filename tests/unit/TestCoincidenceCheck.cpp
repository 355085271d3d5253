// Two particles at one place make the mobility matrix singular. The tests show at which distance
// this happens, and that the check finds such pairs.

#include "HydrodynamicSupport.h"
#include "TestSupport.h"
#include "mobility/CoincidenceCheck.h"
#include "mobility/models/rotneprager/RotnePragerYamakawa.h"

using namespace RigidHIPlugin;
using namespace RigidHITest;
using namespace std;

namespace {

HydrodynamicParticles freeParticles(const vector<double>& radii, bool torque = false) {
    HydrodynamicParticles particles;
    for (size_t i = 0; i < radii.size(); i++) particles.add(radii[i], torque, i, -1);
    return particles;
}

/** The smallest eigenvalue of the matrix of two particles in units in which every diagonal entry
 * is 1. */
double smallestEigenvalue(double distance, double otherRadius, bool torque) {
    RotnePragerYamakawa model(freeParticles({1, otherRadius}, torque), 1);
    MatrixXd M;
    model.at({{Vec3(), Vec3(0.6, 0, 0.8) * distance}})->dense(M);
    const VectorXd d = M.diagonal().cwiseSqrt().cwiseInverse();
    return Eigen::SelfAdjointEigenSolver<MatrixXd>(MatrixXd(d.asDiagonal() * M * d.asDiagonal()))
        .eigenvalues()[0];
}

}  // namespace

TEST(CoincidenceCheck, ItsBoundIsWhereTheMatrixBecomesSingular) {
    // The smallest eigenvalue is at least 3/16 of the larger of the relative distance and the
    // relative difference of radii.
    for (bool torque : {false, true})
        for (double distance : {0.0, 1e-6, 1e-4, 1e-2})
            for (double excess : {0.0, 1e-6, 1e-4, 1e-2}) {
                const double smallest = smallestEigenvalue(distance, 1 + excess, torque),
                             larger = max(distance, excess);
                EXPECT_GT(smallest, 0.187 * larger - 1e-15)
                    << distance << " " << excess << " " << torque;
                EXPECT_LT(smallest, 0.51 * larger + 1e-15)
                    << distance << " " << excess << " " << torque;
            }
    CoincidenceCheck check;
    for (double distance : {0.0, 0.99e-6, 1.01e-6})
        for (double excess : {0.0, 0.99e-6, 1.01e-6})
            EXPECT_EQ(
                check.find(freeParticles({1, 1 + excess}), {Vec3(), Vec3(0, distance, 0)}, 1).first,
                max(distance, excess) < 1e-6 ? 0 : -1);
}

TEST(CoincidenceCheck, FindsTheFirstPairAmongMany) {
    mt19937 random(3);
    const int n = 500;
    CoincidenceCheck check;
    for (int repeat = 0; repeat < 20; repeat++) {
        // The particles are on a lattice, where many share coordinates, and far from the origin.
        vector<Vec3> places;
        for (int i = 0; i < n; i++)
            places.push_back(Vec3(i % 8, i / 8 % 8, i / 64) * 0.1 + Vec3(1000, -2000, 300));
        shuffle(places.begin(), places.end(), random);
        const HydrodynamicParticles particles = freeParticles(vector<double>(n, 0.05));
        EXPECT_EQ(check.find(particles, places, 1).first, -1);
        int i = random() % n, j = random() % n, k = random() % n;
        if (i == j) continue;
        places[i] = places[j];
        places[k] = places[j] + Vec3(0, 0, 2e-8);
        vector<int> together = {i, j, k};
        sort(together.begin(), together.end());
        together.erase(unique(together.begin(), together.end()), together.end());
        const auto pair = check.find(particles, places, 1);
        EXPECT_EQ(pair.first, together[0]);
        EXPECT_EQ(pair.second, together[1]);
    }
}

TEST(CoincidenceCheck, SitesOfOneBodyHaveABoundOfTheirOwn) {
    HydrodynamicParticles particles;
    for (int body : {0, 0, 1}) particles.add(0.5, false, particles.size() + 7, body);
    CoincidenceCheck check;
    const vector<Vec3> places = {Vec3(), Vec3(0.3e-6, 0, 0), Vec3(0, 0.45e-6, 0)};
    EXPECT_EQ(check.find(particles, places, 1).second, 1);
    EXPECT_EQ(check.find(particles, places, 0.5).second, 2);
    expectError([&] { check.check(particles, places, 1); },
                {"particle 7 (body 0) and particle 8 (body 0), both of radius 0.5 nm, are at the "
                 "same place: 3e-07 nm",
                 "where 5e-07 nm, 1e-6 of the radius", "another site"});
    expectError([&] { check.check(particles, places, 0.5); },
                {"particle 7 (body 0) and particle 9 (body 1)"});
}

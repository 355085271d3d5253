// The templates of the host give the text of the kernels of a device. Run on the host, this text
// gives the results of the templates, bit for bit.

#include <Random123/philox.h>

#include <cmath>
#include <map>
#include <random>

#include "TestSupport.h"
#include "host/BodyLoops-inl.h"
#include "random/CounterNoise.h"
#include "text/KernelText.h"
#include "text/SchemeText.h"

using namespace RigidHIPlugin;
using namespace RigidHITest;
using namespace std;

namespace {

// The words that OpenMM's platforms define, and the random numbers of the kernels as a part of this
// program.
#define DEVICE static inline
#define GAUSSIAN NoiseStream::Gaussian
#define TWO_POINT NoiseStream::TwoPoint
#define NOISE_KEY NoiseStream::keyWord
using mm_ulong = unsigned long long;
using number = double;
#include "kernels/trigonometry.cc"
// which the noise needs
#include "kernels/noise.cc"

using Values = map<string, double>;

const char* const axes[3] = {"_x", "_y", "_z"};

/** Random values of all variables of a body. */
Values randomValues(mt19937& generator) {
    normal_distribution<double> normal;
    Values v;
    for (const char* name : {"R", "p", "l", "force", "torque", "decay_l", "noise_l", "move_q",
                             "noise_q", "inverseMoment", "xi1", "eta1", "xi2", "eta2"})
        for (const char* axis : axes) v[string(name) + axis] = normal(generator);
    for (const char* name : {"inverseMass", "decay_p", "noise_p", "move_R", "noise_R"})
        v[name] = normal(generator);
    double square = 0;
    for (const char* name : {"q_w", "q_x", "q_y", "q_z"}) {
        v[name] = normal(generator);
        square += v[name] * v[name];
    }
    for (const char* name : {"q_w", "q_x", "q_y", "q_z"}) v[name] /= sqrt(square);
    v["h"] = 0.0123;
    return v;
}

scalar::Vector3<double> vectorOf(const Values& v, const string& name) {
    return {v.at(name + "_x"), v.at(name + "_y"), v.at(name + "_z")};
}

/** The templates over double, with these values. */
class BodyOfValues : public scalar::BodyMoves<double, double, BodyOfValues> {
public:
    BodyOfValues(const Values& v, RotorKind kind) : v(v), kind(kind) {
        R = vectorOf(v, "R");
        p = vectorOf(v, "p");
        l = vectorOf(v, "l");
        q = {v.at("q_w"), v.at("q_x"), v.at("q_y"), v.at("q_z")};
        force_lab = vectorOf(v, "force");
        torque = vectorOf(v, "torque");
        inverseMass = v.at("inverseMass");
        inverseMoments = vectorOf(v, "inverseMoment");
    }
    RotorKind rotor() const { return kind; }
    bool hasNoise() const { return true; }
    double decay_p() const { return v.at("decay_p"); }
    double noise_p() const { return v.at("noise_p"); }
    double move_R() const { return v.at("move_R"); }
    double noise_R() const { return v.at("noise_R"); }
    scalar::Vector3<double> decay_l() const { return vectorOf(v, "decay_l"); }
    scalar::Vector3<double> noise_l() const { return vectorOf(v, "noise_l"); }
    scalar::Vector3<double> move_q() const { return vectorOf(v, "move_q"); }
    scalar::Vector3<double> noise_q() const { return vectorOf(v, "noise_q"); }
    void drawNoise(int draw, scalar::Vector3<double>& xi, scalar::Vector3<double>& eta) {
        draws[draw]++;
        xi = vectorOf(v, "xi" + to_string(draw + 1));
        eta = vectorOf(v, "eta" + to_string(draw + 1));
    }
    int draws[2] = {0, 0};

private:
    const Values& v;
    const RotorKind kind;
};

class FreeOfValues : public scalar::FreeParticleMoves<double, double, FreeOfValues> {
public:
    explicit FreeOfValues(const Values& v) : v(v) {
        r = vectorOf(v, "R");
        this->v_ = vectorOf(v, "p");
        FreeParticleMoves::v = v_;
        force = vectorOf(v, "force");
        inverseMass = v.at("inverseMass");
    }
    double decay_p() const { return v.at("decay_p"); }
    double noise_p() const { return v.at("noise_p"); }
    double move_R() const { return v.at("move_R"); }
    double noise_R() const { return v.at("noise_R"); }
    void drawNoise(int draw, scalar::Vector3<double>& xi, scalar::Vector3<double>&) {
        xi = vectorOf(v, "xi" + to_string(draw + 1));
    }

private:
    const Values& v;
    scalar::Vector3<double> v_;
};

void expectSame(const Values& found, const string& name, const scalar::Vector3<double>& expected,
                const string& where) {
    EXPECT_EQ(found.at(name + "_x"), expected.x) << where << ": " << name;
    EXPECT_EQ(found.at(name + "_y"), expected.y) << where << ": " << name;
    EXPECT_EQ(found.at(name + "_z"), expected.z) << where << ": " << name;
}

}  // namespace

TEST(KernelText, IsTheTemplatesOfAllSchemesBitByBit) {
    mt19937 generator(3);
    vector<CustomRigidHIIntegrator::Scheme> schemes = thermostats();
    schemes.push_back(CustomRigidHIIntegrator::LangevinHI);
    const pair<DeviceKind, RotorKind> kinds[] = {{DeviceKind::General, RotorKind::General},
                                                 {DeviceKind::Linear, RotorKind::Linear},
                                                 {DeviceKind::Point, RotorKind::Point}};
    for (auto scheme : schemes)
        for (int sample = 0; sample < 20; sample++) {
            const Values values = randomValues(generator);
            for (const auto& kind : kinds)
                for (bool before : {true, false}) {
                    const string where = "scheme " + to_string(scheme) + ", kind " +
                                         to_string((int)kind.first) +
                                         (before ? ", before" : ", after");
                    BodyOfValues body(values, kind.second);
                    scalar::withThermostat(scheme, [&](auto named) {
                        if (before) {
                            named.beforeForces(body, values.at("h"));
                            renormalise(body.q);
                        } else
                            named.afterForces(body, values.at("h"));
                    });
                    const SchemeProgram part = before ? beforeForcesOf(scheme, kind.first, true)
                                                      : afterForcesOf(scheme, kind.first, true);
                    Values found = values;
                    runOnHost(part.program, found);
                    expectSame(found, "R", body.R, where);
                    expectSame(found, "p", body.p, where);
                    expectSame(found, "l", body.l, where);
                    const double q[] = {body.q.w, body.q.x, body.q.y, body.q.z};
                    const char* const names[] = {"q_w", "q_x", "q_y", "q_z"};
                    for (int k = 0; k < 4; k++) EXPECT_EQ(found.at(names[k]), q[k]) << where;
                    for (int draw = 0; draw < 2; draw++)
                        EXPECT_EQ(part.draws[draw], body.draws[draw]) << where;
                }
            for (bool before : {true, false}) {
                FreeOfValues particle(values);
                scalar::withThermostat(scheme, [&](auto named) {
                    before ? named.beforeForces(particle, values.at("h"))
                           : named.afterForces(particle, values.at("h"));
                });
                const SchemeProgram part = before ? beforeForcesOf(scheme, DeviceKind::Free, true)
                                                  : afterForcesOf(scheme, DeviceKind::Free, true);
                Values found = values;
                runOnHost(part.program, found);
                expectSame(found, "R", particle.r, "free particle");
                expectSame(found, "p",
                           static_cast<const FreeOfValues&>(particle).FreeParticleMoves::v,
                           "free particle");
            }
        }
}

TEST(KernelText, HasTheRotationMatrixOfAQuaternion) {
    mt19937 generator(4);
    Values v = randomValues(generator);
    const scalar::Rotation<double> A({v["q_w"], v["q_x"], v["q_y"], v["q_z"]});
    runOnHost(rotationProgram(), v);
    const char* const rows[3] = {"A_x", "A_y", "A_z"};
    for (int k = 0; k < 3; k++) {
        EXPECT_EQ(v.at(string(rows[k]) + "x"), A.row[k].x);
        EXPECT_EQ(v.at(string(rows[k]) + "y"), A.row[k].y);
        EXPECT_EQ(v.at(string(rows[k]) + "z"), A.row[k].z);
    }
}

// An output may also be an input, and constants keep all digits.
TEST(KernelText, GivesOutputsAtTheEnd) {
    const Program swap = trace([] {
        const Line a = Line::input("a"), b = Line::input("b");
        (b + Line(0.1)).output("a");
        (a / Line(3.0)).output("b");
    });
    Values v = {{"a", 1.0}, {"b", 2.0}};
    runOnHost(swap, v);
    EXPECT_EQ(v.at("a"), 2.0 + 0.1);
    EXPECT_EQ(v.at("b"), 1.0 / 3.0);
    const string text = textOf(swap);
    EXPECT_NE(text.find("b + (number) 0.10000000000000001"), string::npos) << text;
    EXPECT_LT(text.find("new_b ="), text.find("\na = new_a")) << text;
}

TEST(KernelText, FormulasOfSchemesMustNotCompareNumbers) {
    const Program plain = trace([] { (Line::input("x") + Line(1.0)).output("y"); });
    EXPECT_NO_THROW(requireNoBranches(plain, "Plain"));
    const Program branching = trace([] {
        const Line x = Line::input("x");
        selectGreater(x, Line(0.0), x, Line(0.0) - x).output("y");
    });
    EXPECT_THROW(requireNoBranches(branching, "Branching"), OpenMM::OpenMMException);
}

TEST(KernelText, RandomNumbersAreThoseOfTheHost) {
    mt19937 generator(5);
    for (int sample = 0; sample < 10000; sample++) {
        NoiseStream noise;
        noise.seed = generator();
        noise.step = (int64_t)generator() << 20 ^ generator();
        const uint32_t purpose = sample % 4, index = generator(), block = sample % 3;
        const auto expected = r123::Philox4x32()(noise.counter(purpose, index, block),
                                                 {{noise.seed, NoiseStream::keyWord}});
        const uint64_t step = noise.step;
        unsigned int word[4] = {(unsigned int)step, (unsigned int)(step >> 32), index,
                                purpose << 24 | block};
        philox(word, noise.seed, NoiseStream::keyWord);
        for (int k = 0; k < 4; k++) ASSERT_EQ(word[k], expected[k]);
        for (auto law : {NoiseStream::Gaussian, NoiseStream::ThreePoint, NoiseStream::TwoPoint}) {
            noise.law = law;
            double a, b, pair[2];
            noise.pair(purpose, index, block, a, b);
            noisePair(noise.seed, step, step >> 32, purpose, index, block, law, pair);
            EXPECT_EQ(pair[0], a);
            EXPECT_EQ(pair[1], b);
        }
    }
}

#include "text/SchemeText.h"

#include <algorithm>

#include "KernelSources.h"
#include "context/Rounding.h"
#include "host/BodyMoves-inl.h"
#include "random/CounterNoise.h"
#include "schemes/Thermostats-inl.h"
#include "text/KernelText.h"

using namespace std;

namespace RigidHIPlugin {

namespace {

using LineVector = scalar::Vector3<Line>;

LineVector inputs(const string& name) {
    return {Line::input(name + "_x"), Line::input(name + "_y"), Line::input(name + "_z")};
}
void outputs(const LineVector& v, const string& name) {
    v.x.output(name + "_x");
    v.y.output(name + "_y");
    v.z.output(name + "_z");
}

/** The random numbers of a draw, which the kernel has made. */
void numbersOf(int draw, LineVector& xi, LineVector& eta) {
    xi = inputs("xi" + to_string(draw + 1));
    eta = inputs("eta" + to_string(draw + 1));
}

class BodyLines : public scalar::BodyMoves<Line, Line, BodyLines> {
public:
    BodyLines(DeviceKind kind, bool hasNoise, SchemeProgram& result)
        : rotor_(kind == DeviceKind::General  ? RotorKind::General
                 : kind == DeviceKind::Linear ? RotorKind::Linear
                                              : RotorKind::Point),
          noise(hasNoise), result(result) {
        R = inputs("R");
        p = inputs("p");
        l = inputs("l");
        q = {Line::input("q_w"), Line::input("q_x"), Line::input("q_y"), Line::input("q_z")};
        force_lab = inputs("force");
        torque = inputs("torque");
        inverseMass = Line::input("inverseMass");
        inverseMoments = inputs("inverseMoment");
    }
    void outputPose() {
        renormalise(q);
        outputs(R, "R");
        q.w.output("q_w");
        q.x.output("q_x");
        q.y.output("q_y");
        q.z.output("q_z");
    }
    void outputMomenta() {
        outputs(p, "p");
        outputs(l, "l");
    }
    RotorKind rotor() const { return rotor_; }
    bool hasNoise() const { return noise; }
    Line decay_p() const { return Line::input("decay_p"); }
    Line noise_p() const { return Line::input("noise_p"); }
    Line move_R() const { return Line::input("move_R"); }
    Line noise_R() const { return Line::input("noise_R"); }
    LineVector decay_l() const { return inputs("decay_l"); }
    LineVector noise_l() const { return inputs("noise_l"); }
    LineVector move_q() const { return inputs("move_q"); }
    LineVector noise_q() const { return inputs("noise_q"); }
    void drawNoise(int draw, LineVector& xi, LineVector& eta) {
        result.draws[draw]++;
        numbersOf(draw, xi, eta);
    }

private:
    const RotorKind rotor_;
    const bool noise;
    SchemeProgram& result;
};

class FreeLines : public scalar::FreeParticleMoves<Line, Line, FreeLines> {
public:
    FreeLines(DeviceKind, bool, SchemeProgram& result) : result(result) {
        r = inputs("R");
        v = inputs("p");
        force = inputs("force");
        inverseMass = Line::input("inverseMass");
    }
    void outputPose() { outputs(r, "R"); }
    void outputMomenta() { outputs(v, "p"); }
    Line decay_p() const { return Line::input("decay_p"); }
    Line noise_p() const { return Line::input("noise_p"); }
    Line move_R() const { return Line::input("move_R"); }
    Line noise_R() const { return Line::input("noise_R"); }
    void drawNoise(int draw, LineVector& xi, LineVector& eta) {
        result.draws[draw]++;
        numbersOf(draw, xi, eta);
    }

private:
    SchemeProgram& result;
};

template <class Lines>
SchemeProgram programOf(CustomRigidHIIntegrator::Scheme scheme, DeviceKind kind, bool hasNoise,
                        bool before) {
    SchemeProgram result;
    result.program = trace([&] {
        Lines flow(kind, hasNoise, result);
        scalar::withThermostat(scheme, [&](auto named) {
            const Line h = Line::input("h");
            if (before) {
                named.beforeForces(flow, h);
                flow.outputPose();
            } else
                named.afterForces(flow, h);
        });
        flow.outputMomenta();
    });
    requireNoBranches(result.program, traitsOf(scheme).name);
    return result;
}

SchemeProgram programOf(CustomRigidHIIntegrator::Scheme scheme, DeviceKind kind, bool hasNoise,
                        bool before) {
    return kind == DeviceKind::Free ? programOf<FreeLines>(scheme, kind, hasNoise, before)
                                    : programOf<BodyLines>(scheme, kind, hasNoise, before);
}

}  // namespace

void requireNoBranches(const Program& program, const string& scheme) {
    if (!program.getComparisons().empty())
        throw OpenMM::OpenMMException(
            "CustomRigidHIIntegrator: the formulas of scheme " + scheme +
            " compare numbers, and the text of a kernel would have one of the two answers only; "
            "write them without comparisons, or keep this scheme on the host");
}

SchemeProgram beforeForcesOf(CustomRigidHIIntegrator::Scheme scheme, DeviceKind kind,
                             bool hasNoise) {
    return programOf(scheme, kind, hasNoise, true);
}

SchemeProgram afterForcesOf(CustomRigidHIIntegrator::Scheme scheme, DeviceKind kind,
                            bool hasNoise) {
    return programOf(scheme, kind, hasNoise, false);
}

Program rotationProgram() {
    return trace([] {
        const scalar::Rotation<Line> A(
            {Line::input("q_w"), Line::input("q_x"), Line::input("q_y"), Line::input("q_z")});
        const char* const rows[3] = {"A_x", "A_y", "A_z"};
        for (int k = 0; k < 3; k++) {
            A.row[k].x.output(string(rows[k]) + "x");
            A.row[k].y.output(string(rows[k]) + "y");
            A.row[k].z.output(string(rows[k]) + "z");
        }
    });
}

map<string, string> textsOf(CustomRigidHIIntegrator::Scheme scheme) {
    map<string, string> texts;
    const struct {
        DeviceKind kind;
        const char* name;
    } kinds[] = {{DeviceKind::General, "GENERAL"},
                 {DeviceKind::Linear, "LINEAR"},
                 {DeviceKind::Point, "POINT"},
                 {DeviceKind::Free, "FREE"}};
    for (const auto& k : kinds) {
        texts[string("BEFORE_") + k.name] = textOf(beforeForcesOf(scheme, k.kind, true).program);
        texts[string("AFTER_") + k.name] = textOf(afterForcesOf(scheme, k.kind, true).program);
    }
    // Single moves of free particles, between which constraints act; the time is t.
    const auto move = [&](const string& name, auto action) {
        SchemeProgram unused;
        texts[name] = textOf(trace([&] {
            FreeLines flow(DeviceKind::Free, true, unused);
            action(flow, Line::input("t"));
            flow.outputPose();
            flow.outputMomenta();
        }));
    };
    move("FREE_KICK", [](FreeLines& flow, const Line& t) { flow.kick(t); });
    move("FREE_DRIFT", [](FreeLines& flow, const Line& t) { flow.drift(t); });
    move("FREE_DAMP", [](FreeLines& flow, const Line&) { flow.damp(); });
    move("FREE_NOISE", [](FreeLines& flow, const Line&) { flow.addNoise(0); });
    // Several kernels turn the same sites, and the positions must agree bit for bit. The text
    // stands in a macro, so it must be one line.
    NumberType exactly;
    exactly.exact = true;
    texts["ROTATION"] = textOf(rotationProgram(), exactly);
    replace(texts["ROTATION"].begin(), texts["ROTATION"].end(), '\n', ' ');
    return texts;
}

KernelProgram programOf(const BodiesOnDevice& bodies) {
    KernelProgram program;
    program.source = KernelSources::numbers + KernelSources::trigonometry + KernelSources::noise +
                     replaceWords(KernelSources::bodies, textsOf(bodies.scheme));
    const auto define = [&](const string& name, long long value) {
        program.defines[name] = to_string(value);
    };
    define("GENERAL", (int)DeviceKind::General);
    define("LINEAR", (int)DeviceKind::Linear);
    define("POINT", (int)DeviceKind::Point);
    define("FREE", (int)DeviceKind::Free);
    define("HELD", (int)DeviceKind::Held);
    define("GAUSSIAN", NoiseStream::Gaussian);
    define("TWO_POINT", NoiseStream::TwoPoint);
    program.defines["NOISE_KEY"] = to_string(NoiseStream::keyWord) + "u";
    define("NUM_SLOTS", bodies.slots);
    define("NUM_BODY_SLOTS", bodies.bodySlots);
    define("NUM_PARTICLES", bodies.particles);
    define("PADDED_PARTICLES", bodies.paddedParticles);
    define("SUM_THREADS", sumThreads);
    define("FIRST_DRAW", NoiseStream::FirstDraw);
    define("SECOND_DRAW", NoiseStream::SecondDraw);
    define("FREE_FIRST_DRAW", NoiseStream::FreeFirstDraw);
    define("FREE_SECOND_DRAW", NoiseStream::FreeSecondDraw);
    program.defines["LARGEST_FORCE"] = to_string(largestFixedPointForce);
    define("MOMENTUM_PARTS", momentumParts);
    if (bodies.isPeriodic) define("PERIODIC", 1);
    if (bodies.hasMomenta) define("HAS_MOMENTA", 1);
    if (bodies.isConstrained) {
        define("CONSTRAINED", 1);
        define("KICK", Kick);
        define("DRIFT", Drift);
        define("DAMP", Damp);
        define("NOISE", Noise);
    }
    for (bool before : {true, false}) {
        int drawn[2] = {0, 0};
        for (DeviceKind kind : {DeviceKind::General, DeviceKind::Free}) {
            const SchemeProgram part = programOf(bodies.scheme, kind, true, before);
            for (int draw = 0; draw < 2; draw++) drawn[draw] += part.draws[draw];
        }
        const string part = before ? "BEFORE" : "AFTER";
        if (drawn[0] > 0) define(part + "_DRAWS_FIRST", 1);
        if (drawn[1] > 0) define(part + "_DRAWS_SECOND", 1);
    }
    return program;
}

}  // namespace RigidHIPlugin

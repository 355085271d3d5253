#ifndef RIGIDHI_SCHEME_TEXT_H_
#define RIGIDHI_SCHEME_TEXT_H_

#include <map>
#include <string>

#include "openmmrigidhi/CustomRigidHIIntegrator.h"
#include "text/KernelText.h"

namespace RigidHIPlugin {

/** The kinds of bodies that kernels know. Held bodies have forces only. */
enum class DeviceKind { General = 0, Linear = 1, Point = 2, Free = 3, Held = 4 };

/**
 * The moves of a scheme for one body of a kind, as a program: the templates of schemes/thermostats,
 * run over lines. Inputs and outputs have the names of the variables of kernels/bodies.cc.
 */
struct SchemeProgram {
    Program program;
    /** How often the program adds the numbers of the first and the second draw of a step. */
    int draws[2] = {0, 0};
};

/**
 * The text of a scheme has no branches: the formulas must not compare numbers.
 * @throws OpenMMException if the program does
 */
void requireNoBranches(const Program& program, const std::string& scheme);

/** The part of a step before the forces, with the new poses. */
SchemeProgram beforeForcesOf(CustomRigidHIIntegrator::Scheme scheme, DeviceKind kind,
                             bool hasNoise);
/** The part after the forces. */
SchemeProgram afterForcesOf(CustomRigidHIIntegrator::Scheme scheme, DeviceKind kind, bool hasNoise);
/** The rotation matrix A_xx ... A_zz of the quaternion q. */
Program rotationProgram();

/** All words of kernels/bodies.cc that stand for text of a scheme, and their text. */
std::map<std::string, std::string> textsOf(CustomRigidHIIntegrator::Scheme scheme);

/** The settings and sizes that the kernels of bodies are made for. */
struct BodiesOnDevice {
    CustomRigidHIIntegrator::Scheme scheme = CustomRigidHIIntegrator::LangevinC;
    int slots = 0, bodySlots = 0;            // of bodies and free particles, and of bodies alone
    int particles = 0, paddedParticles = 0;  // of OpenMM
    bool isPeriodic = false;
    bool isConstrained = false;  // some constraint joins free particles
    bool hasMomenta = true;
};
/**
 * The number of threads in a group that sums up, and the number of partial sums of momenta before
 * it.
 */
const int sumThreads = 128, momentumParts = 4096;
/** The moves of free particles with constraints, as the kernel numbers them. */
enum FreeMove { Kick, Drift, Damp, Noise };

KernelProgram programOf(const BodiesOnDevice& bodies);

}  // namespace RigidHIPlugin

#endif

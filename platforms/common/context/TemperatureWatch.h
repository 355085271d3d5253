#ifndef RIGIDHI_TEMPERATURE_WATCH_H_
#define RIGIDHI_TEMPERATURE_WATCH_H_

#include <string>

#include "host/MidStep.h"

namespace RigidHIPlugin {

class Scene;

/**
 * Watches the mid-step temperatures of bodies during steps, and reports temperatures that stay
 * above or below what the scheme should give at the temperature of the bath. In that case the step
 * is too long, or forces are not conservative.
 *
 * The watch treats translation and rotation apart, over one window of steps after another. A window
 * lasts 20 relaxation times of the slowest thermostatted axis. The first window begins one such
 * time span after the start, or after the last change from outside, so that a scene may relax. A
 * temperature counts as wrong if it is off by more than a band and five standard errors. Shorter
 * windows of four relaxation times find temperatures that are off by a third, before a scene
 * explodes. An explosion itself ends the run.
 *
 * Only a fluid or friction, at a temperature above 0, makes a temperature that can be expected. The
 * watch is off without them, in a driven flow, and where a CustomBodyForce depends on time or
 * velocities. Checkpoints and States do not contain the watch, and no step depends on it
 * otherwise.
 */
class TemperatureWatch {
public:
    /** Settings or bodies have changed. Find the expected temperatures, and begin anew. */
    void adopt(const Scene& scene);
    /** Positions, velocities or the state were set from outside. Begin anew. */
    void restart();
    /** A step has ended. @return whether to call look() */
    bool countStep() { return isOn && ++steps % interval == 0; }
    /**
     * Add the energies at the end of this step.
     * @param now  midStepEnergiesOfMeans(), with the forces at the end of the step
     * @throws OpenMMException  if the run has exploded
     */
    void look(const Scene& scene, const MidStepEnergies& now);
    /**
     * The finding of the last whole window, or of all windows together, as a sentence for users;
     * empty if nothing is wrong.
     */
    const std::string& getFinding() const { return finding; }
    /** The length of a window in steps; 0 if the watch is off. */
    long long getWindow() const { return isOn ? window : 0; }

    /** The kinetic temperature of one kind of motion in a window. */
    struct Expectation {
        int degrees = 0;
        double energy = 0;            // expected of a right run, kJ/mol
        double perRate = 0;           // sum over degrees of freedom of 1/(their relaxation a step)
        double relativeVariance = 0;  // of the mean energy of a window
        void add(int degrees, double relaxation, double energy);
        /** Whether the mean energy over this number of windows is out of the band. */
        bool isTooHigh(double energy, double band, double windows = 1) const;
        bool isTooLow(double energy, double band, double windows = 1) const;
    };

private:
    /**
     * The number of steps between two looks at the kinetic energies. A look takes 4 ns a body, and
     * a step of a free body 59 ns. At usual frictions, momenta change little over 100 steps, so
     * that more looks would tell little more.
     */
    static const int interval = 100;
    /**
     * Judge sums of energies.
     * @param looksOfSum  the number of looks in the sums
     * @param number      their steps, in steps of a window
     * @param leastBand   of relative errors that count as wrong
     */
    void judge(const Scene& scene, const MidStepEnergies& energies, double looksOfSum,
               double number, double leastBand);
    void lookForExplosion(const Scene& scene, const MidStepEnergies& now) const;
    bool isOn = false;
    Expectation translation, rotation;
    int removed = 0;                        // degrees of freedom that a CMMotionRemover may take
    double totalMass = 0, totalMoment = 0;  // of the bodies that are not held
    double largestSize = 0;                 // twice the largest radius of gyration, nm
    long long window = 0, shortWindow = 0;  // steps
    // Since the start, and of the present window.
    long long steps = 0, looks = 0, windows = 0, looksOfShort = 0;
    MidStepEnergies sum, sumOfWindows, sumOfShort;  // of the parts that change
    MidStepEnergies noise;                          // the part that does not change
    std::string finding;
};

}  // namespace RigidHIPlugin

#endif

#ifndef RIGIDHI_ROTNE_PRAGER_YAMAKAWA_GRID_H_
#define RIGIDHI_ROTNE_PRAGER_YAMAKAWA_GRID_H_

#include <memory>
#include <mutex>
#include <string>

#include "mobility/models/ewald/SplitBox.h"
#include "mobility/models/forcecoupling/GridFluid.h"

namespace RigidHIPlugin {

class SplitParts;

/**
 * Rotne-Prager-Yamakawa mobility in a periodic box with edges along the axes, without a matrix:
 * pairs and waves, split so that both parts are positive. PeriodicRotnePragerYamakawa is the same
 * mobility as a matrix, by lattice sums.
 *
 * Equation:  M = M_near + M_waves. M_waves,ij = (1/(eta V)) sum_k D_i^+ H(k) (1 - k k/k^2) k^-2 D_j
 * exp(i k.r_ij), D(F) = sin(ka)/(ka) F, D(T) = (i/2) k x T 3 j_1(ka)/(ka), H(k) = (1 + k^2/4 xi^2)
 * exp(-k^2/4 xi^2); M_near is the rest, with 1 - H. All blocks, unequal radii, overlap, images.
 * Method:    waves on a grid: points spread one Gaussian, and each mode has the factor of the
 * particles' surfaces over that of the Gaussian (GridChannel). Pairs: NearField. Both are symmetric
 * to rounding. The norm of the error of products is below the tolerance times the norm of the
 * mobility, both over the roots of own mobilities. Noise:     that of waves is a random field, of
 * numbers that belong to wave vectors; that of pairs is M_near^(1/2) W by Lanczos, whose matrix is
 * sparse and well conditioned. Cost:      grows as the number of particles at constant density. Six
 * transforms a product for each radius, and six for each radius of spheres with torque. Reference:
 * Fiore, Balboa Usabiaga, Donev, Swan, J. Chem. Phys. 146, 124116 (2017); Lindbo, Tornberg, J.
 * Comput. Phys. 230, 8744 (2011). Limits:    at most `mostRadii` different radii; pairwise; near
 * contact no lubrication.
 */
class RotnePragerYamakawaGrid : public MobilityModel {
public:
    /** Each radius has transforms and modes of its own. */
    static constexpr int mostRadii = 8;
    /**
     * @param tolerance  of products
     * @param spacing    of nodes, nm, at most; 0: the fastest
     * @param fluid      what several models may share
     */
    RotnePragerYamakawaGrid(const HydrodynamicParticles& particles, double viscosity,
                            double tolerance, double spacing,
                            const std::shared_ptr<GridFluid>& fluid);
    const char* name() const override { return "RotnePragerYamakawa"; }
    void checkBox(const BoxVectors& box) const override;
    std::string describe(const BoxVectors& box) const override;
    bool isHomogeneous() const override { return true; }
    bool isDivergenceFree() const override { return true; }
    bool isMatrixFree() const override { return true; }
    bool isAnchored() const override { return true; }
    bool hasOwnRandomField() const override { return true; }
    bool fieldIsLocal() const override { return false; }
    void drawField(const NoiseStream& noise, uint32_t purpose, const BoxVectors& box,
                   std::unique_ptr<RandomField>& field) const override;
    double fluidVolume(const BoxVectors& box) const override {
        return box[0][0] * box[1][1] * box[2][2];
    }
    WaveFactors waveFactors(double radius, double k) const override;
    void checkWave(const BoxVectors& box, int axis, int periods) const override;
    GridSeconds getGridSeconds() const override { return fluid->getSeconds(); }

    const std::vector<EwaldKind>& getKinds() const { return kinds; }
    double getTolerance() const { return tolerance; }
    /** The splitting for a box, which depends on nothing else. */
    EwaldSplitting splittingFor(const BoxVectors& box) const;
    /** All that depends on the box alone. */
    std::shared_ptr<const SplitBox> inBox(const BoxVectors& box) const;
    /** Make these parts be at a placement; null: none so far. Who asks for one at which another is
     * gets that one's. */
    void move(std::shared_ptr<SplitParts>& parts, const Placement& placement, bool nearby) const;
    /** Give parts that are in a box, anywhere, not to be moved. */
    void setBox(std::shared_ptr<SplitParts>& parts,
                const std::shared_ptr<const SplitBox>& box) const;

protected:
    std::unique_ptr<MobilityAt> makePlace() const override;

private:
    const EwaldSplitting& findSplitting(const BoxVectors& box) const;
    void takeUnshared(std::shared_ptr<SplitParts>& parts) const;
    const double tolerance, spacing;
    const std::vector<EwaldKind> kinds;
    const std::shared_ptr<GridFluid> fluid;
    // What was made last, for who asks for the same: fields and products have the same places.
    // Results do not depend on it.
    mutable std::mutex mutex;
    mutable std::unique_ptr<EwaldSplitting> lastSplitting;
    mutable BoxVectors lastBox = {};
    mutable std::shared_ptr<const SplitBox> lastInBox;
    mutable std::shared_ptr<SplitParts> kept;
};

}  // namespace RigidHIPlugin

#endif

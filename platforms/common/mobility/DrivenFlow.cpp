#include "mobility/DrivenFlow.h"

#include <algorithm>
#include <cmath>

namespace RigidHIPlugin {

using Eigen::Matrix3d;
using Eigen::Vector3d;

/** Written with exponentials of distances from the planes, which do not overflow at any height. */
DrivenFlow::Profile DrivenFlow::profileAt(double z) const {
    if (!hasPlanes) return {};
    const double scale = 1 / (1 + std::exp(-k * (top - low))),
                 fromLow = scale * std::exp(-k * (z - low)),
                 fromTop = scale * std::exp(-k * (top - z));
    return {fromLow + fromTop, k * (fromTop - fromLow)};
}

double DrivenFlow::largestGradient() const {
    const double acrossPlanes = slope.norm() + (bend.isZero(0) ? 0 : bend.norm() * (top - low));
    return std::max({gradient.cwiseAbs().maxCoeff(), std::abs(k * waveVelocity), acrossPlanes});
}

namespace {

/** In widths. The part of a Gaussian beyond this distance is 1e-19. */
const double endOfGaussian = 9;

}  // namespace

/** An envelope along z: a normalised Gaussian. */
class DrivenFlow::Gaussian {
public:
    Gaussian(double mean, double width) : mean(mean), width(width) {}
    /** The integral of 1 from z = first to z = end. */
    double part(double first, double end) const {
        return 0.5 * (std::erfc((first - mean) / (std::sqrt(2) * width)) -
                      std::erfc((end - mean) / (std::sqrt(2) * width)));
    }
    /** Likewise the integrals of z - mean and of its square. */
    double firstMoment(double first, double end) const {
        return width * width * (density(first) - density(end));
    }
    double secondMoment(double first, double end) const {
        return width * width * (part(first, end) + timesDensity(first) - timesDensity(end));
    }
    Gaussian moved(double by) const { return {mean + by, width}; }
    bool reaches(double first, double end) const {
        return std::max(first - mean, mean - end) < endOfGaussian * width;
    }

    const double mean, width;

private:
    double density(double z) const {
        const double x = (z - mean) / width;
        return std::exp(-0.5 * x * x) / (std::sqrt(2 * M_PI) * width);
    }
    double timesDensity(double z) const { return std::isfinite(z) ? (z - mean) * density(z) : 0; }
};

bool DrivenFlow::mayReachThrough(double z, double width) const {
    return hasPlanes && width > 0 && std::min(z - low, high - z) < endOfGaussian * width;
}

Vector3d DrivenFlow::steadyAt(double z) const {
    Vector3d v = velocity + gradient.col(2) * z + (z - low) * slope;
    if (!bend.isZero(0)) v += (z - low) * (top - z) * bend;
    return v;
}

Vector3d DrivenFlow::steadySlopeAt(double z) const {
    Vector3d result = gradient.col(2) + slope;
    if (!bend.isZero(0)) result += ((top - z) - (z - low)) * bend;
    return result;
}

/** Add the flow between the planes. */
void DrivenFlow::addBetween(const Gaussian& envelope, Averages& sum) const {
    if (!envelope.reaches(low, high)) return;
    const double z = envelope.mean, part = envelope.part(low, high),
                 moment = envelope.firstMoment(low, high);
    const Vector3d steadySlope = steadySlopeAt(z);
    sum.steady +=
        part * steadyAt(z) + moment * steadySlope - envelope.secondMoment(low, high) * bend;
    sum.steadySlope += part * steadySlope - 2 * moment * bend;
    if (waveVelocity == 0) return;
    // Along the wave, the Gaussian takes the factor exp(-(k width)^2/2). Along z, a Gaussian times
    // an exponential is another Gaussian, times the inverse of this factor.
    const double shift = k * envelope.width * envelope.width,
                 scale = 1 / (1 + std::exp(-k * (top - low))),
                 fromLow =
                     scale * std::exp(-k * (z - low)) * envelope.moved(-shift).part(low, high),
                 fromTop = scale * std::exp(-k * (top - z)) * envelope.moved(shift).part(low, high);
    sum.wave += std::exp(-0.5 * shift * k) * part - fromLow - fromTop;
    sum.waveSlope += k * (fromLow - fromTop);
}

/**
 * Add the flow beyond a plane, up to the next image of the other one: it has no forces, and moves
 * with the planes.
 */
void DrivenFlow::addBeyond(const Gaussian& envelope, bool above, double gap, Averages& sum) const {
    const double plane = above ? high : low, other = above ? low : high, sign = above ? 1 : -1,
                 first = above ? high : low - gap, end = above ? high + gap : low;
    if (!envelope.reaches(first, end)) return;
    const double beyond = sign * (envelope.mean - plane), part = envelope.part(first, end);
    const Vector3d here = steadyAt(plane), steadySlope = sign / gap * (steadyAt(other) - here);
    sum.steady += part * (here + sign * beyond * steadySlope) +
                  envelope.firstMoment(first, end) * steadySlope;
    sum.steadySlope += part * steadySlope;
    if (waveVelocity == 0) return;
    // With s the distance beyond the plane: (here sinh k(gap - s) + there sinh ks)/sinh(k gap)
    const double ofHere = 1 - profileAt(plane).p, ofThere = 1 - profileAt(other).p,
                 shift = sign * k * envelope.width * envelope.width,
                 rest = -std::expm1(-2 * k * gap),
                 up = envelope.moved(shift).part(first, end) / rest,
                 down = envelope.moved(-shift).part(first, end) / rest,
                 rising = up * (ofThere * std::exp(k * (beyond - gap)) -
                                ofHere * std::exp(k * (beyond - 2 * gap))),
                 falling = down * (ofHere * std::exp(-k * beyond) -
                                   ofThere * std::exp(-k * (beyond + gap)));
    sum.wave += rising + falling;
    sum.waveSlope += sign * k * (rising - falling);
}

DrivenFlow::Averages DrivenFlow::averagesAt(double z, double width, double gap) const {
    Averages sum;
    const Gaussian envelope(z, width);
    addBetween(envelope, sum);
    if (!std::isfinite(high)) return sum;
    const double period = high - low + gap;
    for (const bool above : {false, true}) {
        addBeyond(envelope, above, gap, sum);
        addBetween(envelope.moved(above ? -period : period), sum);
    }
    return sum;
}

Vector3d DrivenFlow::velocityAt(const Vector3d& x, const WaveFactors& factors) const {
    if (mayReachThrough(x[2], factors.width)) {
        const Averages averages = averagesAt(x[2], factors.width, factors.gap);
        Vector3d v = averages.steady;
        v[forceAxis] += averages.wave * waveVelocity * std::sin(k * x[waveAxis] + phase);
        return v;
    }
    Vector3d v = velocity + gradient * x;
    if (!slope.isZero(0)) v += (x[2] - low) * slope;
    if (!bend.isZero(0)) v += ((x[2] - low) * (top - x[2]) - 2 * factors.laplacian) * bend;
    if (waveVelocity != 0)
        v[forceAxis] +=
            (factors.s - profileAt(x[2]).p) * waveVelocity * std::sin(k * x[waveAxis] + phase);
    return v;
}

Matrix3d DrivenFlow::gradientAt(const Vector3d& x, double t) const {
    Matrix3d G = gradient;
    if (!slope.isZero(0)) G.col(2) += slope;
    if (!bend.isZero(0)) G.col(2) += ((top - x[2]) - (x[2] - low)) * bend;
    if (waveVelocity != 0) {
        const Profile profile = profileAt(x[2]);
        const double angle = k * x[waveAxis] + phase;
        G(forceAxis, waveAxis) += (t - profile.p) * waveVelocity * k * std::cos(angle);
        if (hasPlanes) G(forceAxis, 2) -= profile.slope * waveVelocity * std::sin(angle);
    }
    return G;
}

Matrix3d DrivenFlow::averageGradientAt(const Vector3d& x, const WaveFactors& factors) const {
    if (!mayReachThrough(x[2], factors.torqueWidth)) return gradientAt(x, factors.t);
    const Averages averages = averagesAt(x[2], factors.torqueWidth, factors.gap);
    const double angle = k * x[waveAxis] + phase;
    Matrix3d G = Matrix3d::Zero();
    G.col(2) = averages.steadySlope;
    G(forceAxis, waveAxis) += averages.wave * waveVelocity * k * std::cos(angle);
    G(forceAxis, 2) += averages.waveSlope * waveVelocity * std::sin(angle);
    return G;
}

Vector3d DrivenFlow::angularVelocityAt(const Vector3d& x, const WaveFactors& factors) const {
    const Matrix3d G = averageGradientAt(x, factors);
    return 0.5 * Vector3d(G(2, 1) - G(1, 2), G(0, 2) - G(2, 0), G(1, 0) - G(0, 1));
}

Matrix3d DrivenFlow::strainRateAt(const Vector3d& x, const WaveFactors& factors) const {
    const Matrix3d G = gradientAt(x, factors.t);
    return 0.5 * (G + G.transpose());
}

Vector3d DrivenFlow::mean() const {
    if (!hasPlanes) return Vector3d::Zero();
    const double height = high - low, width = top - low;
    Vector3d sum = 0.5 * height * slope;
    if (!bend.isZero(0)) sum += (0.5 * height * width - height * height / 3) * bend;
    return sum;
}

double DrivenFlow::meanOfWave() const {
    if (!hasPlanes) return 1;
    const double height = high - low;
    return 1 - (profileAt(high).slope - profileAt(low).slope) / (k * k * height);
}

}  // namespace RigidHIPlugin

// Spreading, solving and averaging on a grid, compiled once for each instruction set, and the way of planes through them.

#include "host/SimdTargets.h"  // must precede foreach_target.h

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "mobility/models/forcecoupling/CpuGridFluid.cpp"
#include "hwy/foreach_target.h"  // must precede highway.h

#include <fftw3.h>

#include <algorithm>
#include <cstring>

#include "hwy/contrib/math/math-inl.h"
#include "hwy/highway.h"
#include "mobility/models/forcecoupling/CpuGridFluid.h"
#include "openmmrigidhi/internal/FourierPlanner.h"

#undef RIGIDHI_TARGET
#define RIGIDHI_TARGET HWY_NAMESPACE

#ifndef RIGIDHI_CPU_GRID_FLUID_LOOPS_
#define RIGIDHI_CPU_GRID_FLUID_LOOPS_
namespace RigidHIPlugin {

/** Columns of a block: neighbours along z, so that what is gathered fills cache lines. */
const int columnsOfBlock = 8;

/** A plane of nodes: rows along z one after the other, three components. */
struct GridPlane {
    double* values[3];
    int rowLength, numRows;
    /** Where row y begins, which may be beyond the last by some boxes. */
    size_t row(int y) const {
        while (y >= numRows) y -= numRows;
        return (size_t)y * rowLength;
    }
};

/** The wave vectors of a block of columns along x. */
struct GridColumns {
    double* modes[3];      // numbers 2 columnsOfBlock of each x: real and imaginary parts
    const double* kx;      // of each x
    const double* keepsX;  // 0 for the Nyquist index, else 1
    int size;              // along x
    double ky;
    double kz[2 * columnsOfBlock], keeps[2 * columnsOfBlock];  // of each number; 0: its mode is left out
    bool hasZero;                                              // whether the first column has the mode k = 0 at x = 0
};

}  // namespace RigidHIPlugin
#endif

HWY_BEFORE_NAMESPACE();
#include "host/SimdReal-inl.h"

namespace RigidHIPlugin {
namespace HWY_NAMESPACE {

typedef HWY_CAPPED(double, GridStencils::padding) Lanes;

/** What a particle adds to one of the planes that it reaches: the slice `i` of its stencil. */
void spreadSlice(const GridStencils& stencils, int p, bool hasTorque, int i, const double* F, const GridPlane& plane) {
    typedef GridStencils Weights;
    const Lanes d;
    const int width = hn::Lanes(d);
    const GridStencils::Stencil& s = stencils[p];
    const double *x = stencils.weightsOf(p, 0, Weights::Force), *y = stencils.weightsOf(p, 1, Weights::Force),
                 *z = stencils.weightsOf(p, 2, Weights::Force);
    const double *tx = nullptr, *ty = nullptr, *tz = nullptr, *gx = nullptr, *gy = nullptr, *gz = nullptr;
    if (hasTorque) {
        tx = stencils.weightsOf(p, 0, Weights::Torque);
        ty = stencils.weightsOf(p, 1, Weights::Torque);
        tz = stencils.weightsOf(p, 2, Weights::Torque);
        gx = stencils.weightsOf(p, 0, Weights::TorqueSlope);
        gy = stencils.weightsOf(p, 1, Weights::TorqueSlope);
        gz = stencils.weightsOf(p, 2, Weights::TorqueSlope);
    }
    const GridStencils::Range rows = stencils.rowsOf(p, i);
    for (int j = rows.begin; j < rows.end; j++) {
        const GridStencils::Range range = stencils.nodesOf(p, i, j);
        const size_t row = plane.row(s.first[1] + j) + s.first[2];
        double *u = plane.values[0] + row, *v = plane.values[1] + row, *w = plane.values[2] + row;
        const double xy = x[i] * y[j];
        const auto fx = hn::Set(d, xy * F[0]), fy = hn::Set(d, xy * F[1]), fz = hn::Set(d, xy * F[2]);
        if (!hasTorque) {
            for (int k = range.begin; k < range.end; k += width) {
                const auto weight = hn::LoadU(d, z + k);
                hn::Store(hn::MulAdd(fx, weight, hn::Load(d, u + k)), d, u + k);
                hn::Store(hn::MulAdd(fy, weight, hn::Load(d, v + k)), d, v + k);
                hn::Store(hn::MulAdd(fz, weight, hn::Load(d, w + k)), d, w + k);
            }
            continue;
        }
        // grad(Theta) x T/2, Theta = tx ty tz: what the slopes along x and y and that along z are multiplied by.
        const double *T = F + 3, sx = 0.5 * gx[i] * ty[j], sy = 0.5 * tx[i] * gy[j], sz = 0.5 * tx[i] * ty[j];
        const auto ut = hn::Set(d, sy * T[2]), ug = hn::Set(d, -sz * T[1]), vt = hn::Set(d, -sx * T[2]),
                   vg = hn::Set(d, sz * T[0]), wt = hn::Set(d, sx * T[1] - sy * T[0]);
        for (int k = range.begin; k < range.end; k += width) {
            const auto weight = hn::LoadU(d, z + k), turn = hn::LoadU(d, tz + k), slope = hn::LoadU(d, gz + k);
            const auto a = hn::MulAdd(ug, slope, hn::MulAdd(ut, turn, hn::Load(d, u + k)));
            const auto b = hn::MulAdd(vg, slope, hn::MulAdd(vt, turn, hn::Load(d, v + k)));
            const auto c = hn::MulAdd(wt, turn, hn::Load(d, w + k));
            hn::Store(hn::MulAdd(fx, weight, a), d, u + k);
            hn::Store(hn::MulAdd(fy, weight, b), d, v + k);
            hn::Store(hn::MulAdd(fz, weight, c), d, w + k);
        }
    }
}

/** The transpose: what a slice adds to the velocities of its particle. */
void averageSlice(const GridStencils& stencils, int p, bool hasTorque, int i, const GridPlane& plane, double* V) {
    typedef GridStencils Weights;
    const Lanes d;
    const int width = hn::Lanes(d);
    const GridStencils::Stencil& s = stencils[p];
    const double *x = stencils.weightsOf(p, 0, Weights::Force), *y = stencils.weightsOf(p, 1, Weights::Force),
                 *z = stencils.weightsOf(p, 2, Weights::Force);
    auto sum_u = hn::Zero(d), sum_v = hn::Zero(d), sum_w = hn::Zero(d);
    auto turn_x = hn::Zero(d), turn_y = hn::Zero(d), turn_z = hn::Zero(d);
    const GridStencils::Range rows = stencils.rowsOf(p, i);
    for (int j = rows.begin; j < rows.end; j++) {
        const GridStencils::Range range = stencils.nodesOf(p, i, j);
        const size_t row = plane.row(s.first[1] + j) + s.first[2];
        const double *u = plane.values[0] + row, *v = plane.values[1] + row, *w = plane.values[2] + row;
        auto row_u = hn::Zero(d), row_v = hn::Zero(d), row_w = hn::Zero(d);
        for (int k = range.begin; k < range.end; k += width) {
            const auto weight = hn::LoadU(d, z + k);
            row_u = hn::MulAdd(weight, hn::Load(d, u + k), row_u);
            row_v = hn::MulAdd(weight, hn::Load(d, v + k), row_v);
            row_w = hn::MulAdd(weight, hn::Load(d, w + k), row_w);
        }
        const auto xy = hn::Set(d, x[i] * y[j]);
        sum_u = hn::MulAdd(xy, row_u, sum_u);
        sum_v = hn::MulAdd(xy, row_v, sum_v);
        sum_w = hn::MulAdd(xy, row_w, sum_w);
        if (!hasTorque) continue;
        const double *tz = stencils.weightsOf(p, 2, Weights::Torque),
                     *gz = stencils.weightsOf(p, 2, Weights::TorqueSlope);
        auto t_u = hn::Zero(d), t_v = hn::Zero(d), t_w = hn::Zero(d), g_u = hn::Zero(d), g_v = hn::Zero(d);
        for (int k = range.begin; k < range.end; k += width) {
            const auto turn = hn::LoadU(d, tz + k), slope = hn::LoadU(d, gz + k);
            const auto uk = hn::Load(d, u + k), vk = hn::Load(d, v + k), wk = hn::Load(d, w + k);
            t_u = hn::MulAdd(turn, uk, t_u);
            t_v = hn::MulAdd(turn, vk, t_v);
            t_w = hn::MulAdd(turn, wk, t_w);
            g_u = hn::MulAdd(slope, uk, g_u);
            g_v = hn::MulAdd(slope, vk, g_v);
        }
        const double tx = stencils.weightsOf(p, 0, Weights::Torque)[i],
                     ty = stencils.weightsOf(p, 1, Weights::Torque)[j];
        const auto sx = hn::Set(d, 0.5 * stencils.weightsOf(p, 0, Weights::TorqueSlope)[i] * ty),
                   sy = hn::Set(d, 0.5 * tx * stencils.weightsOf(p, 1, Weights::TorqueSlope)[j]),
                   sz = hn::Set(d, 0.5 * tx * ty);
        turn_x = hn::NegMulAdd(sy, t_w, hn::MulAdd(sz, g_v, turn_x));
        turn_y = hn::NegMulAdd(sz, g_u, hn::MulAdd(sx, t_w, turn_y));
        turn_z = hn::NegMulAdd(sx, t_v, hn::MulAdd(sy, t_u, turn_z));
    }
    V[0] = hn::GetLane(hn::SumOfLanes(d, sum_u));
    V[1] = hn::GetLane(hn::SumOfLanes(d, sum_v));
    V[2] = hn::GetLane(hn::SumOfLanes(d, sum_w));
    if (!hasTorque) return;
    V[3] = hn::GetLane(hn::SumOfLanes(d, turn_x));
    V[4] = hn::GetLane(hn::SumOfLanes(d, turn_y));
    V[5] = hn::GetLane(hn::SumOfLanes(d, turn_z));
}

/** Minus the sums with the slopes of the force envelope: nine numbers. */
void averageGradientSlice(const GridStencils& stencils, int p, int i, const GridPlane& plane, double* gradients) {
    typedef GridStencils Weights;
    const Lanes d;
    const int width = hn::Lanes(d);
    const GridStencils::Stencil& s = stencils[p];
    const double *z = stencils.weightsOf(p, 2, Weights::Force), *slopes = stencils.weightsOf(p, 2, Weights::ForceSlope);
    const double x = stencils.weightsOf(p, 0, Weights::Force)[i], gx = stencils.weightsOf(p, 0, Weights::ForceSlope)[i];
    const double *y = stencils.weightsOf(p, 1, Weights::Force), *gy = stencils.weightsOf(p, 1, Weights::ForceSlope);
    auto along_x = hn::Zero(d), along_y = hn::Zero(d), along_z = hn::Zero(d);
    for (int a = 0; a < 3; a++) {
        along_x = along_y = along_z = hn::Zero(d);
        const GridStencils::Range rows = stencils.rowsOf(p, i);
        for (int j = rows.begin; j < rows.end; j++) {
            const GridStencils::Range range = stencils.nodesOf(p, i, j);
            const double* u = plane.values[a] + plane.row(s.first[1] + j) + s.first[2];
            auto plain = hn::Zero(d), sloped = hn::Zero(d);
            for (int k = range.begin; k < range.end; k += width) {
                const auto uk = hn::Load(d, u + k);
                plain = hn::MulAdd(hn::LoadU(d, z + k), uk, plain);
                sloped = hn::MulAdd(hn::LoadU(d, slopes + k), uk, sloped);
            }
            along_x = hn::NegMulAdd(hn::Set(d, gx * y[j]), plain, along_x);
            along_y = hn::NegMulAdd(hn::Set(d, x * gy[j]), plain, along_y);
            along_z = hn::NegMulAdd(hn::Set(d, x * y[j]), sloped, along_z);
        }
        gradients[3 * a] = hn::GetLane(hn::SumOfLanes(d, along_x));
        gradients[3 * a + 1] = hn::GetLane(hn::SumOfLanes(d, along_y));
        gradients[3 * a + 2] = hn::GetLane(hn::SumOfLanes(d, along_z));
    }
}

/**
 * modes <- scale k^(-2 or -1) (1 - k k/k^2) modes; those left out become 0.
 *
 * @param root  whether by the root of the fluid's response: k^-1
 */
void projectColumns(const GridColumns& columns, double scale, bool root) {
    const Doubles d;
    const int width = hn::Lanes(d), numbers = 2 * columnsOfBlock;
    const auto one = hn::Set(d, 1.0), ky = hn::Set(d, columns.ky);
    for (int x = 0; x < columns.size; x++) {
        double *u = columns.modes[0] + x * numbers, *v = columns.modes[1] + x * numbers,
               *w = columns.modes[2] + x * numbers;
        const auto kx = hn::Set(d, columns.kx[x]),
                   square = hn::Set(d, columns.kx[x] * columns.kx[x] + columns.ky * columns.ky);
        const auto factor = hn::Set(d, scale * columns.keepsX[x]);
        for (int b = 0; b < numbers; b += width) {
            const auto kz = hn::LoadU(d, columns.kz + b);
            auto k2 = hn::MulAdd(kz, kz, square);
            k2 = hn::IfThenElse(hn::Gt(k2, hn::Zero(d)), k2, one);  // left out below
            const auto inverse = hn::Div(one, k2);
            const auto strength =
                hn::Mul(hn::Mul(factor, hn::LoadU(d, columns.keeps + b)), root ? hn::Sqrt(inverse) : inverse);
            const auto fu = hn::LoadU(d, u + b), fv = hn::LoadU(d, v + b), fw = hn::LoadU(d, w + b);
            const auto along = hn::Mul(inverse, hn::MulAdd(kx, fu, hn::MulAdd(ky, fv, hn::Mul(kz, fw))));
            hn::StoreU(hn::Mul(strength, hn::NegMulAdd(along, kx, fu)), d, u + b);
            hn::StoreU(hn::Mul(strength, hn::NegMulAdd(along, ky, fv)), d, v + b);
            hn::StoreU(hn::Mul(strength, hn::NegMulAdd(along, kz, fw)), d, w + b);
        }
    }
    if (columns.hasZero)
        for (double* component : columns.modes) component[0] = component[1] = 0;
}

/** CounterModeNoise::fill() with packs of modes. */
void fillModes(const NoiseStream& noise, uint32_t purpose, const int* nx, int count, int ny, int nz,
               std::complex<double>* numbers) {
    const int width = lanes(Pack(0.0));
    const double half = std::sqrt(0.5);
    for (int i = 0; i < count; i += width) {
        int index[BodySet::blockSize] = {0};
        double sign[BodySet::blockSize] = {0};
        const int valid = std::min(width, count - i);
        for (int k = 0; k < valid; k++) {
            const int s = CounterModeNoise::isMirrored(nx[i + k], ny, nz) ? -1 : 1;
            sign[k] = s * half;
            index[k] = static_cast<int>(NoiseStream::indexOfMode(s * nx[i + k], s * ny, nz));
        }
        Pack n[6];
        noisePairs<3>(noise, purpose, index, NoiseStream::blockOfMode(nz, 0), n);
        double re[BodySet::blockSize], im[BodySet::blockSize];
        for (int c = 0; c < 3; c++) {
            store(n[2 * c], re);
            store(n[2 * c + 1], im);
            for (int k = 0; k < valid; k++) numbers[c * count + i + k] = {half * re[k], sign[k] * im[k]};
        }
    }
}

}  // namespace HWY_NAMESPACE
}  // namespace RigidHIPlugin
HWY_AFTER_NAMESPACE();

#if HWY_ONCE

namespace RigidHIPlugin {

HWY_EXPORT(spreadSlice);
HWY_EXPORT(averageSlice);
HWY_EXPORT(averageGradientSlice);
HWY_EXPORT(projectColumns);
HWY_EXPORT(fillModes);

namespace {

/** Of averages over a slice: a velocity and an angular one, or a gradient. */
const int numbersOfPart = 9;
const int blockNumbers = 2 * columnsOfBlock;

int roundUp(int n, int to) { return (n + to - 1) / to * to; }

void execute(fftw_plan plan, double* from, double* to) {
    fftw_execute_dft(plan, (fftw_complex*)from, (fftw_complex*)to);
}

}  // namespace

struct CpuGridFluid::Plans {
    fftw_plan rowsThere, rowsBack;              // all rows of a plane along z, out of place
    fftw_plan columnsThere[2], columnsBack[2];  // a block of columns along y, x, out of place
};

/** What one thread works with. */
struct CpuGridFluid::Scratch {
    AlignedArray plane[3];               // nodes
    AlignedArray block[3], transformed;  // of columns
    GridSeconds seconds;
};

void SimdModeNoise::fill(const int* nx, int count, int ny, int nz, std::complex<double>* numbers) const {
    HWY_DYNAMIC_DISPATCH(fillModes)(noise, purpose, nx, count, ny, nz, numbers);
}

CpuGridFluid::CpuGridFluid(ForRanges forRanges) : forRanges(std::move(forRanges)) {}

std::unique_ptr<ModeNoise> CpuGridFluid::modeNoise(const NoiseStream& noise, uint32_t purpose) const {
    return std::unique_ptr<ModeNoise>(new SimdModeNoise(noise, purpose));
}

CpuGridFluid::~CpuGridFluid() { release(); }

void CpuGridFluid::release() {
    free.clear();
    if (!plans) return;
    const std::lock_guard<std::mutex> lock(fourierPlanner());
    fftw_destroy_plan(plans->rowsThere);
    fftw_destroy_plan(plans->rowsBack);
    for (int i = 0; i < 2; i++) {
        fftw_destroy_plan(plans->columnsThere[i]);
        fftw_destroy_plan(plans->columnsBack[i]);
    }
    plans.reset();
}

void CpuGridFluid::prepare(const GridStencils& stencils) {
    const bool sameSize = plans && shape.size == stencils.getShape().size;
    shape = stencils.getShape();
    waveNumbers.resize(shape.size[0]);
    waveIndices.resize(shape.size[0]);
    keeps.resize(shape.size[0]);
    for (int x = 0; x < shape.size[0]; x++) {
        waveNumbers[x] = shape.waveNumber(0, x);
        waveIndices[x] = shape.waveIndex(0, x);
        keeps[x] = !shape.isNyquist(0, x);
    }
    // Stencils that cross the end of a row go on beyond it.
    const int length = GridStencils::padded(shape.size[2] + stencils.largestWidth(2));
    if (sameSize && length == rowLength) return;
    release();
    held = memory(shape);
    rowLength = length;
    rowModes = roundUp(shape.numRowModes(), 4);
    const std::array<int, 3>& n = shape.size;
    for (AlignedArray& component : modes) component.resize(2 * (size_t)n[0] * n[1] * rowModes);
    giveBack(takeScratch());
    const std::unique_ptr<Scratch> scratch = takeScratch();
    const std::lock_guard<std::mutex> lock(fourierPlanner());
    plans.reset(new Plans);
    plans->rowsThere = fftw_plan_many_dft_r2c(1, &n[2], n[1], scratch->plane[0].data(), nullptr, 1, rowLength,
                                              (fftw_complex*)modes[0].data(), nullptr, 1, rowModes, FFTW_ESTIMATE);
    plans->rowsBack =
        fftw_plan_many_dft_c2r(1, &n[2], n[1], (fftw_complex*)modes[0].data(), nullptr, 1, rowModes,
                               scratch->plane[0].data(), nullptr, 1, rowLength, FFTW_ESTIMATE | FFTW_DESTROY_INPUT);
    for (int i = 0; i < 2; i++) {
        const int size = n[1 - i];
        fftw_complex *from = (fftw_complex*)scratch->block[0].data(), *to = (fftw_complex*)scratch->transformed.data();
        const auto plan = [&](int sign) {
            return fftw_plan_many_dft(1, &size, columnsOfBlock, from, nullptr, columnsOfBlock, 1, to, nullptr,
                                      columnsOfBlock, 1, sign, FFTW_ESTIMATE);
        };
        plans->columnsThere[i] = plan(FFTW_FORWARD);
        plans->columnsBack[i] = plan(FFTW_BACKWARD);
    }
}

void CpuGridFluid::split(int count, const std::function<void(int, int)>& task) const {
    if (forRanges)
        forRanges(count, task);
    else
        task(0, count);
}

std::unique_ptr<CpuGridFluid::Scratch> CpuGridFluid::takeScratch() {
    {
        const std::lock_guard<std::mutex> lock(scratchMutex);
        if (!free.empty()) {
            std::unique_ptr<Scratch> scratch = std::move(free.back());
            free.pop_back();
            return scratch;
        }
    }
    std::unique_ptr<Scratch> scratch(new Scratch);
    const size_t longest = std::max(shape.size[0], shape.size[1]);
    for (AlignedArray& p : scratch->plane) p.resize((size_t)shape.size[1] * rowLength);
    for (AlignedArray& p : scratch->block) p.resize(longest * blockNumbers);
    scratch->transformed.resize(longest * blockNumbers);
    return scratch;
}

void CpuGridFluid::giveBack(std::unique_ptr<Scratch> scratch) {
    const std::lock_guard<std::mutex> lock(scratchMutex);
    seconds.add(scratch->seconds);
    scratch->seconds = {};
    free.push_back(std::move(scratch));
}

namespace {

/** A block of columns from a grid whose rows are `stride` numbers apart, and back. */
void gather(const double* from, size_t stride, int size, int numbers, double* block) {
    if (numbers == blockNumbers) {
        for (int i = 0; i < size; i++)
            std::memcpy(block + i * blockNumbers, from + i * stride, sizeof(double) * blockNumbers);
        return;
    }
    for (int i = 0; i < size; i++) {
        std::memcpy(block + i * blockNumbers, from + i * stride, sizeof(double) * numbers);
        std::fill(block + i * blockNumbers + numbers, block + (i + 1) * blockNumbers, 0.0);
    }
}
void scatter(const double* block, size_t stride, int size, int numbers, double* to) {
    for (int i = 0; i < size; i++) std::memcpy(to + i * stride, block + i * blockNumbers, sizeof(double) * numbers);
}

}  // namespace

/** Along y, of one plane of modes. */
void CpuGridFluid::transformColumns(double* plane, bool forward, Scratch& scratch) const {
    const size_t stride = 2 * (size_t)rowModes;
    const int size = shape.size[1];
    for (int first = 0; first < shape.numRowModes(); first += columnsOfBlock) {
        const int numbers = 2 * std::min(columnsOfBlock, shape.numRowModes() - first);
        gather(plane + 2 * first, stride, size, numbers, scratch.block[0].data());
        execute(forward ? plans->columnsThere[0] : plans->columnsBack[0], scratch.block[0].data(),
                scratch.transformed.data());
        scatter(scratch.transformed.data(), stride, size, numbers, plane + 2 * first);
    }
}

/** Calls action(columns) for the blocks of columns along x with this y. */
template <class Action>
void CpuGridFluid::forColumns(int y, Scratch& scratch, const Action& action) const {
    GridColumns columns;
    columns.size = shape.size[0];
    columns.kx = waveNumbers.data();
    columns.keepsX = keeps.data();
    columns.ky = shape.waveNumber(1, y);
    const bool out = shape.isNyquist(1, y);
    for (int first = 0; first < shape.numRowModes(); first += columnsOfBlock) {
        for (int c = 0; c < 3; c++) columns.modes[c] = scratch.block[c].data();
        for (int b = 0; b < columnsOfBlock; b++) {
            const int z = first + b;
            const bool none = out || z >= shape.numRowModes() || shape.isNyquist(2, z);
            for (int part = 0; part < 2; part++) {
                columns.kz[2 * b + part] = none ? 1 : 2 * M_PI / shape.edge[2] * z;
                columns.keeps[2 * b + part] = !none;
            }
        }
        columns.hasZero = y == 0 && first == 0;
        action(columns, first, std::min(columnsOfBlock, shape.numRowModes() - first));
    }
}

/** There, through the fluid, and back, along x. */
void CpuGridFluid::solveColumns(int y, double viscosity, Scratch& scratch) {
    const size_t stride = 2 * (size_t)rowModes * shape.size[1], row = 2 * (size_t)rowModes * y;
    const double scale = 1 / (viscosity * shape.numNodes());
    forColumns(y, scratch, [&](GridColumns& columns, int first, int count) {
        double* const spare = scratch.transformed.data();
        for (int c = 0; c < 3; c++) {
            gather(modes[c].data() + row + 2 * first, stride, shape.size[0], 2 * count, spare);
            execute(plans->columnsThere[1], spare, scratch.block[c].data());
        }
        HWY_DYNAMIC_DISPATCH(projectColumns)(columns, scale, false);
        for (int c = 0; c < 3; c++) {
            execute(plans->columnsBack[1], scratch.block[c].data(), spare);
            scatter(spare, stride, shape.size[0], 2 * count, modes[c].data() + row + 2 * first);
        }
    });
}

void CpuGridFluid::drawColumns(int y, double viscosity, const ModeNoise& noise, Scratch& scratch) {
    const size_t stride = 2 * (size_t)rowModes * shape.size[1], row = 2 * (size_t)rowModes * y;
    const double scale = 1 / std::sqrt(viscosity * shape.numNodes());
    std::vector<std::complex<double>> numbers(3 * shape.size[0]);
    forColumns(y, scratch, [&](GridColumns& columns, int first, int count) {
        for (int b = 0; b < columnsOfBlock; b++) {
            const bool none = columns.keeps[2 * b] == 0;
            if (!none) noise.fill(waveIndices.data(), shape.size[0], shape.waveIndex(1, y), first + b, numbers.data());
            for (int c = 0; c < 3; c++)
                for (int x = 0; x < shape.size[0]; x++) {
                    double* to = scratch.block[c].data() + x * blockNumbers + 2 * b;
                    to[0] = none ? 0 : numbers[c * shape.size[0] + x].real();
                    to[1] = none ? 0 : numbers[c * shape.size[0] + x].imag();
                }
        }
        HWY_DYNAMIC_DISPATCH(projectColumns)(columns, scale, true);
        for (int c = 0; c < 3; c++) {
            execute(plans->columnsBack[1], scratch.block[c].data(), scratch.transformed.data());
            scatter(scratch.transformed.data(), stride, shape.size[0], 2 * count, modes[c].data() + row + 2 * first);
        }
    });
}

void CpuGridFluid::multiplyColumn(const GridStencils& stencils, double viscosity, const double* forces,
                                  double* velocities) {
    prepare(stencils);
    const HydrodynamicParticles& particles = stencils.getParticles();
    const std::array<int, 3>& n = shape.size;
    const size_t planeModes = 2 * (size_t)n[1] * rowModes, planeNodes = (size_t)n[1] * rowLength;
    split(n[0], [&](int first, int end) {
        std::unique_ptr<Scratch> scratch = takeScratch();
        GridPlane plane = {
            {scratch->plane[0].data(), scratch->plane[1].data(), scratch->plane[2].data()}, rowLength, n[1]};
        for (int x = first; x < end; x++) {
            {
                const TimeOfLife timer(scratch->seconds.spreading);
                for (double* component : plane.values) std::fill(component, component + planeNodes, 0.0);
                for (int s = stencils.beginOfPlane(x); s < stencils.beginOfPlane(x + 1); s++) {
                    const GridStencils::Slice slice = stencils.slice(s);
                    stencils.prefetchAfter(s);
                    HWY_DYNAMIC_DISPATCH(spreadSlice)
                    (stencils, slice.particle, particles.hasTorque[slice.particle], slice.i,
                     forces + particles.firstRow[slice.particle], plane);
                }
                for (double* component : plane.values)
                    for (int y = 0; y < n[1]; y++) {
                        double* row = component + (size_t)y * rowLength;
                        for (int k = n[2]; k < rowLength; k++) row[k % n[2]] += row[k];
                    }
            }
            for (int c = 0; c < 3; c++) {
                const TimeOfLife timer(scratch->seconds.transforms);
                double* to = modes[c].data() + planeModes * x;
                fftw_execute_dft_r2c(plans->rowsThere, plane.values[c], (fftw_complex*)to);
                transformColumns(to, true, *scratch);
            }
        }
        giveBack(std::move(scratch));
    });
    split(n[1], [&](int first, int end) {
        std::unique_ptr<Scratch> scratch = takeScratch();
        for (int y = first; y < end; y++) {
            const TimeOfLife timer(scratch->seconds.transforms);
            solveColumns(y, viscosity, *scratch);
        }
        giveBack(std::move(scratch));
    });
    parts.resize(numbersOfPart * (size_t)stencils.beginOfPlane(n[0]));
    split(n[0], [&](int first, int end) {
        std::unique_ptr<Scratch> scratch = takeScratch();
        GridPlane plane = {
            {scratch->plane[0].data(), scratch->plane[1].data(), scratch->plane[2].data()}, rowLength, n[1]};
        for (int x = first; x < end; x++) {
            for (int c = 0; c < 3; c++) planeBack(c, x, plane.values[c], *scratch);
            const TimeOfLife timer(scratch->seconds.averaging);
            averagePlane(stencils, x, plane);
        }
        giveBack(std::move(scratch));
    });
    sumVelocities(stencils, velocities);
}

/** From modes to nodes, with what stencils look at beyond the ends of rows. */
void CpuGridFluid::planeBack(int component, int x, double* nodes, Scratch& scratch) {
    const std::array<int, 3>& n = shape.size;
    const TimeOfLife timer(scratch.seconds.transforms);
    double* from = modes[component].data() + 2 * (size_t)n[1] * rowModes * x;
    transformColumns(from, false, scratch);
    fftw_execute_dft_c2r(plans->rowsBack, (fftw_complex*)from, nodes);
    for (int y = 0; y < n[1]; y++) {
        double* row = nodes + (size_t)y * rowLength;
        for (int k = n[2]; k < rowLength; k++) row[k] = row[k - n[2]];
    }
}

void CpuGridFluid::averagePlane(const GridStencils& stencils, int x, const GridPlane& plane) {
    const HydrodynamicParticles& particles = stencils.getParticles();
    for (int s = stencils.beginOfPlane(x); s < stencils.beginOfPlane(x + 1); s++) {
        const GridStencils::Slice slice = stencils.slice(s);
        stencils.prefetchAfter(s);
        HWY_DYNAMIC_DISPATCH(averageSlice)
        (stencils, slice.particle, particles.hasTorque[slice.particle], slice.i, plane,
         &parts[numbersOfPart * (size_t)s]);
    }
}

/** A particle's slices are summed in their order, whichever thread averaged over them. */
void CpuGridFluid::sumParts(const GridStencils& stencils, int p, int numbers, double* sum) const {
    std::fill(sum, sum + numbers, 0.0);
    for (int i = 0; i < stencils[p].width[0]; i++) {
        const double* part = &parts[numbersOfPart * (size_t)stencils.sliceOf(p, i)];
        for (int c = 0; c < numbers; c++) sum[c] += part[c];
    }
}

void CpuGridFluid::sumVelocities(const GridStencils& stencils, double* velocities) const {
    const HydrodynamicParticles& particles = stencils.getParticles();
    split(particles.size(), [&](int first, int end) {
        for (int p = first; p < end; p++)
            sumParts(stencils, p, particles.hasTorque[p] ? 6 : 3, velocities + particles.firstRow[p]);
    });
}

void CpuGridFluid::drawModes(const GridStencils& stencils, double viscosity, const ModeNoise& noise, GridField& field) {
    prepare(stencils);
    field.shape = shape;
    field.rowLength = rowLength;
    const std::array<int, 3>& n = shape.size;
    const size_t planeNodes = (size_t)n[1] * rowLength;
    for (AlignedArray& component : field.values) component.resize(n[0] * planeNodes);
    split(n[1], [&](int first, int end) {
        std::unique_ptr<Scratch> scratch = takeScratch();
        for (int y = first; y < end; y++) drawColumns(y, viscosity, noise, *scratch);
        giveBack(std::move(scratch));
    });
    split(n[0], [&](int first, int end) {
        std::unique_ptr<Scratch> scratch = takeScratch();
        for (int x = first; x < end; x++)
            for (int c = 0; c < 3; c++) {
                // By way of aligned memory, for which the transform is planned.
                planeBack(c, x, scratch->plane[c].data(), *scratch);
                std::copy(scratch->plane[c].data(), scratch->plane[c].data() + planeNodes,
                          field.values[c].data() + planeNodes * x);
            }
        giveBack(std::move(scratch));
    });
}

namespace {

GridPlane planeOf(const GridField& field, int x) {
    const size_t first = (size_t)x * field.shape.size[1] * field.rowLength;
    GridPlane plane;
    // Averaging only reads.
    for (int c = 0; c < 3; c++) plane.values[c] = const_cast<double*>(field.values[c].data()) + first;
    plane.rowLength = field.rowLength;
    plane.numRows = field.shape.size[1];
    return plane;
}

}  // namespace

void CpuGridFluid::averageColumn(const GridField& field, const GridStencils& stencils, double* velocities) {
    parts.resize(numbersOfPart * (size_t)stencils.beginOfPlane(field.shape.size[0]));
    split(field.shape.size[0], [&](int first, int end) {
        std::unique_ptr<Scratch> scratch = takeScratch();
        {
            const TimeOfLife timer(scratch->seconds.averaging);
            for (int x = first; x < end; x++) averagePlane(stencils, x, planeOf(field, x));
        }
        giveBack(std::move(scratch));
    });
    sumVelocities(stencils, velocities);
}

void CpuGridFluid::averageGradientColumn(const GridField& field, const GridStencils& stencils, double* gradients) {
    parts.resize(numbersOfPart * (size_t)stencils.beginOfPlane(field.shape.size[0]));
    split(field.shape.size[0], [&](int first, int end) {
        for (int x = first; x < end; x++)
            for (int s = stencils.beginOfPlane(x); s < stencils.beginOfPlane(x + 1); s++) {
                stencils.prefetchAfter(s);
                HWY_DYNAMIC_DISPATCH(averageGradientSlice)
                (stencils, stencils.slice(s).particle, stencils.slice(s).i, planeOf(field, x),
                 &parts[numbersOfPart * (size_t)s]);
            }
    });
    split(stencils.size(), [&](int first, int end) {
        for (int p = first; p < end; p++) sumParts(stencils, p, 9, gradients + 9 * (size_t)p);
    });
}

}  // namespace RigidHIPlugin

#endif

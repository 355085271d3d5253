#include "context/KernelArrays.h"

#include <openmm/Platform.h>
#include <openmm/kernels.h>

#include <cstring>

using namespace OpenMM;
using namespace std;

namespace RigidHIPlugin {

namespace {

/** Entries that are others than at the last reading are taken over. */
void takeChanged(const vector<Vec3>& now, vector<Vec3>& last, vector<Vec3>& own) {
    for (size_t p = 0; p < now.size(); p++)
        if (memcmp(&now[p], &last[p], sizeof(Vec3)) != 0) own[p] = now[p];
    last = now;
}

}  // namespace

KernelArrays::KernelArrays(ContextImpl& context)
    : ContextArrays(ownPositions, ownVelocities, ownForces), context(context),
      handle(context.getPlatform().createKernel(UpdateStateDataKernel::Name(), context)) {
    kernel().initialize(context.getSystem());
    const int n = context.getSystem().getNumParticles();
    for (auto* array : {&ownPositions, &ownVelocities, &ownForces, &readPositions, &readVelocities, &read})
        array->resize(n);
}

UpdateStateDataKernel& KernelArrays::kernel() const {
    return const_cast<Kernel&>(handle).getAs<UpdateStateDataKernel>();
}

void KernelArrays::pullPositions() {
    kernel().getPositions(context, read);
    takeChanged(read, readPositions, ownPositions);
}

void KernelArrays::pullVelocities() {
    kernel().getVelocities(context, read);
    takeChanged(read, readVelocities, ownVelocities);
}

void KernelArrays::pullForces() { kernel().getForces(context, ownForces); }

void KernelArrays::pushPositions() {
    kernel().setPositions(context, ownPositions);
    kernel().getPositions(context, readPositions);
}

void KernelArrays::pushVelocities() {
    kernel().setVelocities(context, ownVelocities);
    kernel().getVelocities(context, readVelocities);
}

double KernelArrays::getTime() const { return kernel().getTime(context); }

void KernelArrays::setTime(double time) { kernel().setTime(context, time); }

long long KernelArrays::getStepCount() const { return kernel().getStepCount(context); }

void KernelArrays::setStepCount(long long count) { kernel().setStepCount(context, count); }

void KernelArrays::computeVirtualSites() {
    pushPositions();
    context.computeVirtualSites();
    pullPositions();
}

}  // namespace RigidHIPlugin

#include "stepping/StartOfStep.h"

namespace RigidHIPlugin {

void StartOfStep::save() {
    scene.bodies.save(bodySnapshot);
    scene.freeParticles->save(freeSnapshot, scene.arrays->positions(), scene.arrays->velocities());
}

void StartOfStep::show() {
    scene.bodies.restore(bodySnapshot);
    scene.freeParticles->restore(freeSnapshot, scene.arrays->positions(),
                                 scene.arrays->velocities());
}

void StartOfStep::putBack() {
    if (scene.fluid) scene.fluid->getMemory().restore();
    show();
    mirror.writePoses();
}

}  // namespace RigidHIPlugin

#include "stepping/StartOfStep.h"

namespace RigidHIPlugin {

void StartOfStep::save() {
    box = scene.getBox();
    scene.bodies.save(bodySnapshot);
    scene.freeParticles->save(freeSnapshot, scene.arrays->positions(), scene.arrays->velocities());
}

void StartOfStep::show() {
    scene.bodies.restore(bodySnapshot);
    scene.freeParticles->restore(freeSnapshot, scene.arrays->positions(),
                                 scene.arrays->velocities());
}

void StartOfStep::putBack() {
    if (scene.fluid) {
        if (scene.fluid->getContents().userFlow.isSheared()) mirror.setBox(box);
        scene.fluid->getMemory().restore();
    }
    show();
    mirror.writePoses();
}

}  // namespace RigidHIPlugin

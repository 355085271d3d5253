#ifndef RIGIDHI_DEVICE_H_
#define RIGIDHI_DEVICE_H_

#include <openmm/OpenMMException.h>
#include <openmm/common/ComputeArray.h>
#include <openmm/common/ComputeContext.h>

#include <string>
#include <vector>

#include "text/KernelText.h"

namespace RigidHIPlugin {

/**
 * A device, as bodies and products use it: its double precision, compiler and memory. If the device
 * refuses one of these, the message says which, and what the device says. Tests have devices that
 * refuse.
 */
class Device {
public:
    explicit Device(OpenMM::ComputeContext& context) : context(context) {}
    virtual ~Device() {}
    OpenMM::ComputeContext& getContext() const { return context; }
    virtual bool hasDoubles() const { return context.getSupportsDoublePrecision(); }
    /** @throws OpenMMException with the compiler's log */
    virtual OpenMM::ComputeProgram compile(const KernelProgram& program) const {
        try {
            return context.compileProgram(program.source, program.defines);
        } catch (const OpenMM::OpenMMException& error) {
            throw OpenMM::OpenMMException(std::string("its compiler refuses a kernel: ") +
                                          error.what());
        }
    }
    /**
     * Make an array of this size, or change the size of an array.
     *
     * @throws OpenMMException  if the device has no memory for it
     */
    template <class T>
    void reserve(OpenMM::ComputeArray& array, size_t size, const std::string& name) const {
        hold<T>(size, name, [&] {
            if (!array.isInitialized())
                array.initialize<T>(context, size, "rigidhi_" + name);
            else if (static_cast<size_t>(array.getSize()) != size)
                array.resize(size);
        });
    }
    /** Give an array these values, at least one. Some devices take memory only now. */
    template <class T>
    void give(OpenMM::ComputeArray& array, const std::vector<T>& values,
              const std::string& name) const {
        reserve<T>(array, values.size(), name);
        hold<T>(values.size(), name, [&] { array.upload(values); });
    }

protected:
    /** Throws if the device should not have this memory. */
    virtual void requireMemory(size_t /*bytes*/) const {}

private:
    template <class T, class Action>
    void hold(size_t size, const std::string& name, const Action& action) const {
        try {
            requireMemory(size * sizeof(T));
            action();
        } catch (const OpenMM::OpenMMException& error) {
            throw OpenMM::OpenMMException("it cannot hold " + std::to_string(size * sizeof(T)) +
                                          " bytes of " + name + ": " + error.what());
        }
    }
    OpenMM::ComputeContext& context;
};

}  // namespace RigidHIPlugin

#endif

// Debian ships no SWIG interface of OpenMM. These declarations are all that is needed of it.
// OpenMM's Python module registers the same types in SWIG's run-time type table, so the class of
// this plugin is an openmm.Integrator there.
namespace OpenMM {
class Integrator {
public:
    virtual ~Integrator();
};
class Force {
public:
    virtual ~Force();
};
class Context;
}

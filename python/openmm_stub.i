// Debian ships no SWIG interface of OpenMM. This is all that is needed of it: its Python module registers the same types
// in SWIG's run-time type table, so that our class is an openmm.Integrator there.
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

// The formulas of this plugin are templates over the number type: `double` on the Reference
// platform, a SIMD pack on the CPU platform. Highway compiles the CPU platform's source once per
// instruction set, and so includes the headers named *-inl.h several times in one translation unit.
// Their include guards are therefore toggles (the idiom of Highway's own *-inl.h), and all their
// code is in a namespace named after the instruction set. Everywhere else this namespace is
// `scalar`.
#ifndef RIGIDHI_TARGET
#define RIGIDHI_TARGET scalar
#endif

// The formulas of this plugin are templates over the number type: `double` on the Reference
// platform, a SIMD pack on the CPU platform. Highway compiles the CPU platform's source once per
// instruction set, so that the headers named *-inl.h may be included several times in one
// translation unit. Their include guards are therefore toggled (the idiom of Highway's own
// *-inl.h), and all their code is in a namespace named after the instruction set. Everywhere else
// that namespace is `scalar`.
#ifndef RIGIDHI_TARGET
#define RIGIDHI_TARGET scalar
#endif

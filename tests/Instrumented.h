#ifndef RIGIDHI_INSTRUMENTED_H_
#define RIGIDHI_INSTRUMENTED_H_

namespace RigidHITest {

/**
 * Whether a sanitizer instruments the library; steps then take ten to fifty times as long. Errors
 * of memory and of threads show with few bodies and steps as well as with many, so the tests take
 * smaller scenes there.
 */
bool isInstrumented();
/** Bytes that the program has allocated on the heap; 0 where nobody counts them. */
double bytesInUse();
/** `all`, or `few` in an instrumented program. */
template <class T>
T allOrFew(T all, T few) {
    return isInstrumented() ? few : all;
}

}  // namespace RigidHITest

#endif

#ifndef RIGIDHI_ONE_BLAS_THREAD_H_
#define RIGIDHI_ONE_BLAS_THREAD_H_

namespace RigidHIPlugin {

/**
 * Keeps one BLAS thread in the whole process while any object of this class exists, so that results
 * do not depend on the number of threads.
 *
 * The number belongs to the process, not to a thread. Contexts that step at the same time share it,
 * on any platform. The first holder saves the number, and the last one restores it. If other code
 * sets a number other than 1 meanwhile, the last holder restores that number. Until the next holder
 * comes, results of the present holders may then depend on that number.
 *
 * OpenBLAS reads the number once per call, so calls in progress in other threads keep their number.
 *
 * The thread that starts a step must make the object. Tasks that run at the same time must not.
 */
class OneBlasThread {
public:
    OneBlasThread();
    ~OneBlasThread();
    OneBlasThread(const OneBlasThread&) = delete;
    OneBlasThread& operator=(const OneBlasThread&) = delete;
};

}  // namespace RigidHIPlugin

#endif

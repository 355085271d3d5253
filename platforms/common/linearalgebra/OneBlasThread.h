#ifndef RIGIDHI_ONE_BLAS_THREAD_H_
#define RIGIDHI_ONE_BLAS_THREAD_H_

namespace RigidHIPlugin {

/**
 * One BLAS thread in the whole process while any of these lives, so that results do not depend on
 * their number.
 *
 * The number is the process's, not a thread's: Contexts that step at the same time hold it
 * together, whichever platform they are on. The first holder saves it, the last one restores it. If
 * somebody else sets another number than 1 meanwhile, then that is what is restored, but what
 * holders compute until the next one comes may depend on it.
 *
 * OpenBLAS reads the number once a call, so that calls in progress in other threads keep theirs.
 *
 * To be made by the thread that starts a step, not inside of tasks that run at the same time.
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

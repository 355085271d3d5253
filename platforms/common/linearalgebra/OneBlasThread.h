#ifndef RIGIDHI_ONE_BLAS_THREAD_H_
#define RIGIDHI_ONE_BLAS_THREAD_H_

namespace RigidHIPlugin {

/**
 * Keeps one BLAS thread in the whole process while any object of this class exists, so that results
 * do not depend on the number of threads.
 *
 * The number belongs to the process, not to a thread. Contexts that step at the same time hold it
 * together, whichever platform they are on. The first holder saves the number, and the last one
 * restores it. If other code sets a number other than 1 meanwhile, that number is restored. Results
 * of the holders until the next one comes may then depend on it.
 *
 * OpenBLAS reads the number once a call, so that calls in progress in other threads keep theirs.
 *
 * The object must be made by the thread that starts a step, not inside tasks that run at the same
 * time.
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

#include "context/SavedState.h"  // where it lies now

// The only object that is compiled for each platform: it tells the tests in platform/ which one they run on.

#include "TestSupport.h"

std::string RigidHITest::testPlatformName() { return RIGIDHI_TEST_PLATFORM; }

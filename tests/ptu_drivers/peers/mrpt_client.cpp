// Drives a FLIR unit with MRPT's own driver and prints what it saw; the argument is the serial port.
#include <mrpt/hwdrivers/CPtuDPerception.h>

#include <cstdio>

int main(int argc, char** argv)
{
	if (argc != 2) return 2;
	mrpt::hwdrivers::CPtuDPerception unit;
	if (!unit.init(argv[1])) return 1;
	double at = -9, most = -9;
	const bool moved = unit.moveToAbsPos('P', 0.1), waited = unit.aWait();
	const bool asked = unit.absPosQ('P', at), limit = unit.maxPosQ('P', most);
	const bool beyond = unit.moveToAbsPos('P', 6.0);
	std::printf("moved %d awaited %d asked %d at %.4f limit %d %.4f beyond %d\n", moved, waited, asked, at, limit, most, beyond);
	return 0;
}

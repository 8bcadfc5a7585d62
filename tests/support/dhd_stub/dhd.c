/* A stand-in for Force Dimension's libdhd with the calls of docs/examples/force_dimension.py: a device whose grip stays
 * where `stub_place` puts it. Written for this test; it contains nothing of the SDK. */
static double position[3], force[3], largest;
static int opened, enabled, watchdog, zeros, unplugged, commands;

int dhdOpen(void) {
    if (unplugged) return -1;
    opened = 1;
    return 3;
}
int dhdClose(signed char id) {
    opened = 0;
    return id == 3 ? 0 : -1;
}
int dhdEnableForce(unsigned char value, signed char id) {
    enabled = value;
    return id == 3 ? 0 : -1;
}
int dhdSetWatchdog(unsigned char value, signed char id) {
    watchdog = value;
    return id == 3 ? 0 : -1;
}
int dhdSetForce(double x, double y, double z, signed char id) {
    double size = x * x + y * y + z * z;
    if (unplugged || id != 3) return -1;
    force[0] = x, force[1] = y, force[2] = z;
    zeros = size == 0.0 ? zeros + 1 : 0;
    largest = size > largest ? size : largest;
    commands++;
    return 0;
}
int dhdGetPosition(double *x, double *y, double *z, signed char id) {
    *x = position[0], *y = position[1], *z = position[2];
    return unplugged || id != 3 ? -1 : 0;
}

void stub_place(double x, double y, double z) { position[0] = x, position[1] = y, position[2] = z; }
void stub_unplug(int value) { unplugged = value; }
double stub_largest_squared(void) { return largest; }
double stub_force(int axis) { return force[axis]; }
int stub_opened(void) { return opened; }
int stub_enabled(void) { return enabled; }
int stub_watchdog(void) { return watchdog; }
int stub_zeros(void) { return zeros; }
int stub_commands(void) { return commands; }
void stub_reset(void) { largest = 0.0, commands = zeros = unplugged = 0; }

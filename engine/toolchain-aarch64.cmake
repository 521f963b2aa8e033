# Cross build with Debian's gcc-aarch64-linux-gnu; tests run under qemu-user. The libraries come from
# Debian's arm64 packages (dpkg --add-architecture arm64). The emulator must find their C library and
# loader, not those of libc6-arm64-cross: a loader of one and a C library of the other hang in
# pthread_create(). Hence no -L. QEMU_CPU names the processor: cortex-a72 has plain Advanced SIMD,
# cortex-a76 dot products, max everything.
set(CMAKE_SYSTEM_NAME Linux)
set(CMAKE_SYSTEM_PROCESSOR aarch64)
set(CMAKE_C_COMPILER aarch64-linux-gnu-gcc)
set(CMAKE_FIND_ROOT_PATH /usr/aarch64-linux-gnu)
set(CMAKE_FIND_ROOT_PATH_MODE_PROGRAM NEVER)
set(CMAKE_CROSSCOMPILING_EMULATOR qemu-aarch64)
set(ENV{PKG_CONFIG_LIBDIR} /usr/lib/aarch64-linux-gnu/pkgconfig:/usr/share/pkgconfig)

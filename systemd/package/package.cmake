# What is installed, and the Debian packages that `cpack` makes of it:
#
#   diorama             the command line, the shipped weights, the printable boards
#   diorama-appliance   the daemons, their units, board profiles, rules and policies
#   libdvsm-dev         the engine alone, for other programs
include(GNUInstallDirs)

install(TARGETS diorama RUNTIME COMPONENT diorama)
install(DIRECTORY models/ DESTINATION ${CMAKE_INSTALL_DATADIR}/diorama/models COMPONENT diorama
	FILES_MATCHING PATTERN "*.safetensors" PATTERN "*.json" PATTERN "*.md")
install(DIRECTORY board/print DESTINATION ${CMAKE_INSTALL_DATADIR}/diorama COMPONENT diorama)
install(DIRECTORY board/ DESTINATION ${CMAKE_INSTALL_DATADIR}/diorama/boards COMPONENT appliance
	FILES_MATCHING PATTERN "*.ini" PATTERN "*.dts" PATTERN "print" EXCLUDE PATTERN "udev" EXCLUDE)
install(FILES board/udev/70-diorama.rules DESTINATION lib/udev/rules.d COMPONENT appliance)
install(TARGETS dvsm ARCHIVE COMPONENT dev)
install(DIRECTORY engine/include/dvsm DESTINATION ${CMAKE_INSTALL_INCLUDEDIR} COMPONENT dev)
configure_file(${CMAKE_CURRENT_LIST_DIR}/dvsm.pc.in dvsm.pc @ONLY)
install(FILES ${PROJECT_BINARY_DIR}/dvsm.pc DESTINATION ${CMAKE_INSTALL_LIBDIR}/pkgconfig
	COMPONENT dev)
foreach(package diorama diorama-appliance libdvsm-dev)
	if(package STREQUAL "libdvsm-dev")
		set(component dev)
	else()
		string(REPLACE "diorama-" "" component ${package})
	endif()
	install(FILES ${PROJECT_SOURCE_DIR}/LICENSE DESTINATION ${CMAKE_INSTALL_DATADIR}/doc/${package}
		RENAME copyright COMPONENT ${component})
endforeach()

set(CPACK_GENERATOR DEB)
set(CPACK_PACKAGE_NAME diorama)
set(CPACK_PACKAGE_VERSION ${PROJECT_VERSION})
set(CPACK_PACKAGE_DESCRIPTION_SUMMARY "${PROJECT_DESCRIPTION}")
set(CPACK_PACKAGE_CONTACT "Diorama maintainers <maintainers@diorama.invalid>")
set(CPACK_PACKAGING_INSTALL_PREFIX /usr)
set(CPACK_STRIP_FILES ON)
set(CPACK_COMPONENTS_ALL diorama appliance dev)
set(CPACK_COMPONENTS_GROUPING ONE_PER_GROUP)
set(CPACK_DEB_COMPONENT_INSTALL ON)
set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
set(CPACK_DEBIAN_PACKAGE_SHLIBDEPS ON)

set(CPACK_DEBIAN_DIORAMA_PACKAGE_NAME diorama)
set(CPACK_DEBIAN_DIORAMA_PACKAGE_SECTION graphics)
set(CPACK_DEBIAN_DIORAMA_DESCRIPTION "view synthesis from posed pictures, command line and weights
 Calibrates a camera, poses pictures by a printed board, reconstructs a scene
 with a decoder-only view synthesis transformer and renders it from any
 viewpoint.")

set(CPACK_DEBIAN_APPLIANCE_PACKAGE_NAME diorama-appliance)
set(CPACK_DEBIAN_APPLIANCE_PACKAGE_SECTION graphics)
set(CPACK_DEBIAN_APPLIANCE_PACKAGE_DEPENDS "diorama (= ${PROJECT_VERSION}), systemd, udev, dbus")
set(CPACK_DEBIAN_APPLIANCE_PACKAGE_RECOMMENDS "polkitd, libcamera-ipa")
set(CPACK_DEBIAN_APPLIANCE_PACKAGE_CONTROL_EXTRA
	${CMAKE_CURRENT_LIST_DIR}/postinst ${CMAKE_CURRENT_LIST_DIR}/prerm
	${CMAKE_CURRENT_LIST_DIR}/postrm)
set(CPACK_DEBIAN_APPLIANCE_DESCRIPTION "capture-to-render appliance: capture and display daemons
 A capture daemon that owns the camera and a display daemon that tracks,
 reconstructs at the press of a button and renders, under systemd.")

set(CPACK_DEBIAN_DEV_PACKAGE_NAME libdvsm-dev)
set(CPACK_DEBIAN_DEV_PACKAGE_SECTION libdevel)
set(CPACK_DEBIAN_DEV_DESCRIPTION "engine of diorama: decoder-only view synthesis on a CPU
 Static library and headers; needs libc alone.")
include(CPack)

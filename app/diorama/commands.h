/* The sub-commands of `diorama`, one file each. argv[0] is the sub-command's name. */
#ifndef DIO_DIORAMA_COMMANDS_H
#define DIO_DIORAMA_COMMANDS_H

int dio_command_bench(int argc, char **argv);
int dio_command_board(int argc, char **argv);
int dio_command_capture(int argc, char **argv);
int dio_command_calibrate(int argc, char **argv);
int dio_command_poses(int argc, char **argv);
int dio_command_import(int argc, char **argv);
int dio_command_reconstruct(int argc, char **argv);
int dio_command_render(int argc, char **argv);
int dio_command_eval(int argc, char **argv);
int dio_command_info(int argc, char **argv);
int dio_command_view(int argc, char **argv);
int dio_command_ctl(int argc, char **argv);
int dio_command_quantize(int argc, char **argv);
int dio_command_demo(int argc, char **argv);

#endif

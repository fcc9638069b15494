/** What a press sets off: it is sent once, and can be sent again when no answer came. */

import {
  useMutation,
  type UseMutationOptions,
  type UseMutationResult,
} from "@tanstack/react-query";
import { useCallback, useRef } from "react";
import { ApiError } from "./client";

/**
 * `useMutation` for what acts. A second press while the first is under way does nothing, and does
 * not wait for the page to be drawn anew. An error without an answer carries how to try again.
 */
export function useAct<T, V = void>(
  options: UseMutationOptions<T, Error, V>,
): UseMutationResult<T, Error, V> {
  const isBusy = useRef(false);
  const { mutate: begin, ...mutation } = useMutation<T, Error, V>({
    ...options,
    onSettled: (...told) => {
      isBusy.current = false;
      return options.onSettled?.(...told);
    },
  });
  type Pressed = Parameters<typeof begin>;
  const mutate = useCallback(
    (...pressed: Pressed): void => {
      const [wanted, told] = pressed;
      const press = (): void => {
        if (isBusy.current) return;
        isBusy.current = true;
        const heard: typeof told = {
          ...told,
          onError: (error, ...rest) => {
            if (error instanceof ApiError && error.isUnanswered) error.again = press;
            told?.onError?.(error, ...rest);
          },
        };
        begin(...([wanted, heard] as Pressed));
      };
      press();
    },
    [begin],
  );
  return { ...mutation, mutate } as UseMutationResult<T, Error, V>;
}

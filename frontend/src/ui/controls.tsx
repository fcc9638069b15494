/** Buttons, segments, tabs, dialogs and tooltips. */

import { Modal, Tooltip } from "@mantine/core";
import { useEffect, useId, useRef, type ButtonHTMLAttributes, type ReactNode } from "react";
import { Icon, type IconName } from "./icons";

interface ButtonProps extends ButtonHTMLAttributes<HTMLButtonElement> {
  look?: "" | "pri" | "danger" | "ghost";
  large?: boolean;
  /** Why it cannot be pressed; given, the button is disabled and says so. */
  why?: string | null | undefined;
  testId?: string;
}

export function Button(props: ButtonProps) {
  const { look = "", large = false, why, testId, className = "", children, ...rest } = props;
  const button = (
    <button
      type="button"
      {...rest}
      disabled={Boolean(why) || rest.disabled === true}
      data-testid={testId}
      className={`btn ${look} ${large ? "lg" : ""} ${className}`}
    >
      {children}
    </button>
  );
  if (!why) return button;
  return (
    <Hint text={why}>
      <span className="why">{button}</span>
    </Hint>
  );
}

export function IconButton(props: {
  icon: IconName;
  label: string;
  onClick?: () => void;
  disabled?: boolean;
  testId?: string;
  children?: ReactNode;
}) {
  return (
    <Hint text={props.label}>
      <button
        type="button"
        className="ib"
        aria-label={props.label}
        onClick={props.onClick}
        disabled={props.disabled}
        data-testid={props.testId}
      >
        <Icon name={props.icon} />
        {props.children}
      </button>
    </Hint>
  );
}

export function Hint({ text, children }: { text: string; children: ReactNode }) {
  return (
    <Tooltip label={text} openDelay={400} withArrow multiline maw={320} events={TIP_EVENTS}>
      {children}
    </Tooltip>
  );
}

const TIP_EVENTS = { hover: true, focus: true, touch: false };

export function Segments<T extends string>(props: {
  label: string;
  value: T;
  options: readonly { value: T; label: string }[];
  onChange: (value: T) => void;
  className?: string;
}) {
  return (
    <span className={`seg ${props.className ?? ""}`} role="group" aria-label={props.label}>
      {props.options.map((option) => (
        <button
          key={option.value}
          type="button"
          aria-pressed={option.value === props.value ? true : undefined}
          onClick={() => props.onChange(option.value)}
        >
          {option.label}
        </button>
      ))}
    </span>
  );
}

/** A question that needs an answer before anything else; Esc closes it. */
export function Dialog(props: {
  title: string;
  isOpen: boolean;
  onClose: () => void;
  children: ReactNode;
  size?: number;
  testId?: string;
  /** It shows what is shown once: only a button in it closes it. */
  isHeld?: boolean;
}) {
  const isHeld = props.isHeld ?? false;
  return (
    <Modal
      opened={props.isOpen}
      onClose={props.onClose}
      title={props.title}
      size={props.size ?? 440}
      centered
      yOffset="max(5dvh, 60px)" // below the head, which stays in sight with its stop
      transitionProps={{ transition: "fade", duration: 120 }}
      closeButtonProps={{ "aria-label": "Close" }}
      withCloseButton={!isHeld}
      closeOnEscape={!isHeld}
      closeOnClickOutside={!isHeld}
      data-testid={props.testId}
    >
      {props.children}
    </Modal>
  );
}

export function TextField(props: {
  label: string;
  value: string;
  onChange: (value: string) => void;
  help?: string | undefined;
  error?: string | null | undefined;
  lines?: number;
  type?: string;
  autoComplete?: string;
  autoFocus?: boolean;
  placeholder?: string;
  testId?: string;
}) {
  const id = useId();
  const common = {
    id,
    placeholder: props.placeholder,
    value: props.value,
    "aria-invalid": props.error ? true : undefined,
    "aria-describedby": `${id}-help`,
    "data-testid": props.testId,
    "data-autofocus": props.autoFocus ? true : undefined,
    autoComplete: props.autoComplete ?? "off",
  };
  return (
    <div className="field">
      <label htmlFor={id}>{props.label}</label>
      {props.lines ? (
        <textarea
          {...common}
          className="inp"
          rows={props.lines}
          onChange={(event) => props.onChange(event.target.value)}
        />
      ) : (
        <input
          {...common}
          className="inp"
          type={props.type ?? "text"}
          onChange={(event) => props.onChange(event.target.value)}
        />
      )}
      <p id={`${id}-help`} className={props.error ? "help bad" : "help"}>
        {props.error ?? props.help}
      </p>
    </div>
  );
}

/** A refusal where it happened: sentence, findings, and the code to quote. */
export function Refused({ error }: { error: Error | null }) {
  const shown = useRef<HTMLDivElement>(null);
  // What was pressed was switched off while it was sent, and had to let go of the focus.
  useEffect(() => {
    if (error && document.activeElement === document.body) shown.current?.focus();
  }, [error]);
  if (!error) return null;
  const { refusal, again } = error as {
    refusal?: { code: string; findings: { message: string }[] };
    again?: () => void;
  };
  const others = refusal?.findings.filter((finding) => finding.message !== error.message) ?? [];
  return (
    <div className="refused" role="alert" data-testid="refused" tabIndex={-1} ref={shown}>
      <p className="help bad">{error.message}</p>
      {others.map((finding) => (
        <p className="help bad" key={finding.message}>
          {finding.message}
        </p>
      ))}
      {refusal && <p className="mono m">{refusal.code}</p>}
      {again && (
        <Button testId="try-again" onClick={again}>
          Try again
        </Button>
      )}
    </div>
  );
}

using System;
using System.Threading;

namespace Palpate
{
    /// <summary>
    /// Something that waits for the network to begin, made on a thread of its own so that no picture waits, and again a second
    /// after it failed.
    /// </summary>
    sealed class Background<T> where T : class, IDisposable
    {
        readonly Func<T> make;
        readonly Action<string> failed;
        readonly object guard = new object();
        T made;
        string fault;
        DateTime again = DateTime.MinValue;
        bool busy, ended;

        public Background(Func<T> make, Action<string> failed)
        {
            this.make = make;
            this.failed = failed;
        }

        /// <summary>What was made, or null so far.</summary>
        public T Value
        {
            get
            {
                lock (guard)
                {
                    if (fault != null)
                        failed(fault);
                    fault = null;
                    if (made == null && !busy && !ended && DateTime.UtcNow >= again)
                    {
                        busy = true;
                        new Thread(Work) { IsBackground = true }.Start();
                    }
                    return made;
                }
            }
        }

        void Work()
        {
            T value = null;
            string reason = null;
            try
            {
                value = make();
            }
            catch (Exception e)
            {
                reason = e.Message;
            }
            lock (guard)
            {
                busy = false;
                made = ended ? null : value;
                fault = reason;
                again = DateTime.UtcNow.AddSeconds(1);
            }
            if (value != null && made == null)
                value.Dispose();
        }

        /// <summary>Lets go of what was made; it will be made anew.</summary>
        public void Drop()
        {
            T old;
            lock (guard)
            {
                old = made;
                made = null;
                again = DateTime.UtcNow.AddSeconds(1);
            }
            if (old != null)
                old.Dispose();
        }

        /// <summary>Lets go for good.</summary>
        public void End()
        {
            lock (guard)
                ended = true;
            Drop();
        }
    }
}
